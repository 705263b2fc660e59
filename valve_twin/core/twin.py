# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The twin of one valve: signals in; predictions, cycles and estimation jobs out.

The live node and the offline command drive this same machine. It is deterministic: what it emits
depends on the samples, never on when they arrived, on how they were cut into blocks, or on how
long an estimation took. To that end jobs are sequential and never dropped, and the estimate of a
cycle takes effect at the start of the second cycle after it; samples of that cycle wait if the
estimate is not there yet. Who cannot wait any longer calls `go_on`: that cycle is predicted by the
model in force, and its predictions and estimates say that they are not reproducible.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.alignment import Aligner, SignalCounts, SignalRange
from valve_twin.core.cycle_config import CycleConfig
from valve_twin.core.cycles import Closing, Segmenter
from valve_twin.core.estimation.cycle.memory import InForce, Memory, model_in_force
from valve_twin.core.job_queue import JobQueue
from valve_twin.core.prediction import residuals, restart_marks, run_model
from valve_twin.core.state import TwinState, join_parts
from valve_twin.core.types import Cycle, Estimate, FloatArray, Frames, IntArray, Prediction
from valve_twin.core.valves.interface import ModelOptions

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from valve_twin.core.job_queue import QueuedJob
    from valve_twin.core.state import Part, Resume
    from valve_twin.core.valves.interface import Options, ValveModel

EFFECT_DELAY = 2
"""The estimate of a cycle predicts from the start of this many cycles later."""


@dataclass(frozen=True, slots=True)
class TwinConfig:
    """What the twin of one valve needs to know.

    Attributes
    ----------
    period_s : float
        Nominal sampling time of the position [s].
    signals : tuple of SignalRange
        The position first, then the commands in the model's order.
    counter, reference : SignalRange or None
        Optional signals.
    conditions : tuple of SignalRange
        Mapped signals under which the valve runs, see `types.CONDITIONS`.
    cycles : CycleConfig
        How the stream is cut.
    options : mapping
        Options of the model, complete and checked.
    hold_back_s : float
        Longest delay by a silent signal [s].
    """

    period_s: float
    signals: tuple[SignalRange, ...]
    counter: SignalRange | None = None
    reference: SignalRange | None = None
    cycles: CycleConfig = field(default_factory=CycleConfig)
    options: Options = field(default_factory=ModelOptions)
    hold_back_s: float = 2.0
    conditions: tuple[SignalRange, ...] = ()


@dataclass(frozen=True, slots=True)
class Estimated:
    """The estimates of one cycle, every configured estimator; the cycle they come from."""

    cycle: Cycle
    estimates: tuple[Estimate, ...]


@dataclass(frozen=True, slots=True)
class ClockJump:
    """The data's clock was set back; the running cycle was dropped, what was learnt is kept."""

    dropped_cycle: int


Event = Prediction | Cycle | Estimated | ClockJump


@dataclass(frozen=True, slots=True)
class Job:
    """One estimation to run: `estimate_cycle(model, options, cycle, memory)`, in any process."""

    ordinal: int
    cycle: Cycle
    memory: Memory


class Twin:
    """Deterministic state machine of one valve.

    `predicts` may be set to False before the first sample where only estimates are wanted, which
    do not depend on predictions; `in_force` is not followed then.

    Parameters
    ----------
    config : TwinConfig
        Signals, cycle rule and model options.
    model : ValveModel
        The valve's model.
    memory : Memory
        What earlier cycles taught, from the history after a restart.
    last_cycle : int
        Number of the last stored cycle, 0 for a new valve.
    resume : Resume, optional
        What is known of it and of the cycles announced since.
    """

    def __init__(
        self,
        config: TwinConfig,
        model: ValveModel,
        *,
        memory: Memory | None = None,
        last_cycle: int = 0,
        resume: Resume | None = None,
    ) -> None:
        self._config = config
        self._model = model
        self._aligner = Aligner(
            config.signals,
            counter=config.counter,
            reference=config.reference,
            conditions=config.conditions,
            hold_back_s=config.hold_back_s,
        )
        self._segmenter = Segmenter(
            config.cycles,
            model.inputs,
            config.period_s,
            last_cycle=last_cycle,
            resumed=last_cycle > 0,
            resume=resume,
        )
        memory = memory if memory is not None else Memory.empty()
        self._memory_after: dict[int, Memory] = {0: memory}
        self._done = 0
        self._jobs = JobQueue()
        self._running: Job | None = None
        self._waiting: deque[Part] = deque()
        self._ordinal = 0
        self._early: set[int] = set()
        self._in_force = self._force(memory)
        self._state = model.initial_state()
        self._last_ns: int | None = None
        self._jumps = 0
        self.predicts = True

    @property
    def in_force(self) -> InForce | None:
        """The model that predicts now; None before the first accepted estimate."""
        return self._in_force

    @property
    def cycle(self) -> int:
        """Number of the running cycle, 0 between cycles."""
        return self._segmenter.running

    @property
    def pending_jobs(self) -> int:
        """Estimations asked for and not delivered."""
        return len(self._jobs) + (self._running is not None)

    def queue_jobs(self, queue: Callable[[Iterable[QueuedJob]], JobQueue]) -> None:
        """Keep the cycles that wait in the queue that `queue` makes of them."""
        self._jobs = queue(self._jobs)

    @property
    def waits(self) -> bool:
        """Whether samples wait for the estimate that their cycle is due."""
        return bool(self._waiting)

    def snapshot(self) -> TwinState:
        """Return the whole state, at any time between two calls."""
        running = [] if self._running is None else [(self._running.ordinal, self._running.cycle)]
        self._waiting = deque(join_parts(self._waiting))
        return TwinState(
            aligner=self._aligner.snapshot(),
            segmenter=self._segmenter.snapshot(),
            memory_after=tuple(self._memory_after.items()),
            done=self._done,
            ordinal=self._ordinal,
            jobs=(*running, *self._jobs),
            waiting=tuple(self._waiting),
            early=tuple(sorted(self._early)),
            in_force=self._in_force,
            predictor=self._state.copy(),
            last_ns=self._last_ns,
        )

    def restore(self, state: TwinState) -> None:
        """Go on from the snapshot of a twin of equal configuration with the same bits.

        The job that ran then is the next one.

        Raises
        ------
        ValueError
            If it was taken of other signals.
        """
        self._aligner.restore(state.aligner)
        self._segmenter.restore(state.segmenter)
        self._memory_after = dict(state.memory_after)
        self._done, self._ordinal = state.done, state.ordinal
        self._jobs, self._running = JobQueue(state.jobs), None
        self._waiting, self._early = deque(state.waiting), set(state.early)
        self._in_force, self._state = state.in_force, state.predictor.copy()
        self._last_ns = state.last_ns
        self._jumps = state.aligner.jumps

    def leave_out(self, last_cycle: int, resume: Resume | None) -> list[Event]:
        """Drop the running cycle: samples are missing since the snapshot that was restored.

        What was learnt stays, and so do the closed cycles that wait for their estimation.

        Parameters
        ----------
        last_cycle : int
            Number of the last closed cycle [1].
        resume : Resume or None
            What else is known of it, as after a restart without a snapshot.
        """
        if self._segmenter.running:
            self._jobs.append(self._ordinal, None)
        self._aligner.reset()
        self._segmenter.begin_anew(last_cycle, resume)
        self._last_ns = None
        return self._drain()

    def counts(self) -> dict[str, SignalCounts]:
        """Return what happened to the samples of every signal."""
        return self._aligner.counts()

    def number_from(self, last_cycle: int) -> None:
        """Give the cycles to come numbers above `last_cycle`."""
        self._segmenter.number_from(last_cycle)

    def push(
        self, signal: str, stamp_ns: IntArray, values: FloatArray, *, header: bool = True
    ) -> list[Event]:
        """Take samples of one signal.

        Parameters
        ----------
        signal : str
            Signal name.
        stamp_ns : (N,) int64 array
            Stamps [ns].
        values : (N,) array
            Values, after scale and offset [unit of the signal].
        header : bool
            False where the stamps are receive times: the estimate then says that it is not
            reproducible.

        Returns
        -------
        list of Event
            Predictions, closed cycles and clock jumps, in stream order.
        """
        if not header:
            self._segmenter.mark_irreproducible()
        return self._released(self._aligner.push(signal, stamp_ns, values))

    def mark_irreproducible(self) -> None:
        """Note that the running cycle has stamps that are receive times."""
        self._segmenter.mark_irreproducible()

    def push_round(self, parts: Iterable[tuple[str, IntArray, FloatArray]]) -> list[Event]:
        """Take samples of several signals at once, all with stamps of their own.

        Parameters
        ----------
        parts : iterable of (str, (N,) int64 array, (N,) array)
            Signal name, stamps [ns] and values, as for `push`.

        Returns
        -------
        list of Event
            In stream order.
        """
        return self._released(self._aligner.push_round(parts))

    def _released(self, frames: Frames | None) -> list[Event]:
        events: list[Event] = []
        if self._aligner.jumps != self._jumps:
            self._jumps = self._aligner.jumps
            events += self.clock_jumped(data=False)
        if self._aligner.late:
            self._segmenter.mark_late(self._aligner.late)
            self._aligner.late.clear()
        return events + (self._advance(frames) if frames is not None else [])

    def close_cycle(self) -> list[Event]:
        """Close the running cycle on request."""
        return self._take(self._segmenter.close(Closing.ASKED))

    def finish(self) -> list[Event]:
        """Release what is left and close the running cycle, at the end of a record."""
        frames = self._aligner.flush()
        events = self._advance(frames) if frames is not None else []
        return events + self._take(self._segmenter.close(Closing.END))

    def clock_jumped(self, *, data: bool = True) -> list[Event]:
        """Drop the running cycle after the clock was set back; keep what was learnt."""
        dropped = self._segmenter.running
        if dropped:
            self._jobs.append(self._ordinal, None)
        self._segmenter.reset()
        if data:
            self._aligner.reset()
        self._last_ns = None
        return [ClockJump(dropped), *self._drain()]

    def next_job(self) -> Job | None:
        """Return the next estimation to run, or None; one at a time."""
        if self._running is not None:
            return None
        while self._running is None and self._jobs:
            ordinal, cycle = self._jobs.popleft()
            if cycle is None:  # it was dropped, or could not be kept
                self._finish_ordinal(ordinal, self._memory_after[self._done])
                continue
            if ordinal in self._early:
                cycle = replace(cycle, reproducible=False)
            self._running = Job(ordinal, cycle, self._memory_after[self._done])
        return self._running

    def deliver(self, estimates: tuple[Estimate, ...], memory: Memory) -> list[Event]:
        """Take the result of the running job; samples that waited for it go on.

        Raises
        ------
        ValueError
            If no job is running.
        """
        if self._running is None:
            msg = "deliver: no estimation is running"
            raise ValueError(msg)
        job, self._running = self._running, None
        self._finish_ordinal(job.ordinal, memory)
        return [Estimated(job.cycle, estimates), *self._drain()]

    def go_on(self) -> list[Event]:
        """Predict the cycle that waits for its estimate with the model in force.

        Its predictions and estimates say that they are not reproducible, and so do those of the
        cycles after it until one begins with the estimate that it is due. While an estimate is
        missing that an earlier cycle did not wait for, none is waited for.

        Returns
        -------
        list of Event
            The predictions that waited; none where nothing waits.
        """
        if self._waiting:
            self._early.add(self._waiting[0].ordinal)
        return self._drain()

    def _skip_dropped(self) -> None:
        """Pass over dropped cycles: the memory of the predecessor goes on."""
        while self._running is None and self._jobs.begins_dropped:
            ordinal, _ = self._jobs.popleft()
            self._finish_ordinal(ordinal, self._memory_after[self._done])

    def _finish_ordinal(self, ordinal: int, memory: Memory) -> None:
        self._memory_after[ordinal] = memory
        self._done = ordinal
        for old in [k for k in self._memory_after if k < ordinal - EFFECT_DELAY]:
            del self._memory_after[old]
        self._early -= {k for k in self._early if k < ordinal}

    def _advance(self, frames: Frames) -> list[Event]:
        return self._take(self._segmenter.push(frames))

    def _take(self, items: Sequence[Part | Cycle]) -> list[Event]:
        events: list[Event] = []
        for item in items:
            if isinstance(item, Cycle):
                events.append(item)
                self._enqueue(item)
            else:
                self._ordinal = item.ordinal
                self._waiting.append(item)
        return events + self._drain()

    def _enqueue(self, cycle: Cycle) -> None:
        self._jobs.append(self._ordinal, cycle)

    def _drain(self) -> list[Event]:
        """Predict the parts whose model is known; the rest waits."""
        self._skip_dropped()
        events: list[Event] = []
        while self._waiting and self._may_begin(self._waiting[0].ordinal):
            part = self._waiting.popleft()
            if part.opens and self.predicts:
                self._in_force = self._force(self._memory_at(part.ordinal - EFFECT_DELAY))
            if self.predicts:
                events.append(self._predict(part))
        return events

    def _may_begin(self, ordinal: int) -> bool:
        """Return whether a cycle's estimate is there, or is not waited for."""
        if ordinal - EFFECT_DELAY <= self._done or ordinal in self._early:
            return True
        if ordinal - 1 in self._early and ordinal - 1 - EFFECT_DELAY > self._done:
            self._early.add(ordinal)
            return True
        return False

    def _memory_at(self, ordinal: int) -> Memory:
        usable = [k for k in self._memory_after if k <= max(ordinal, 0)]
        return self._memory_after[max(usable, default=min(self._memory_after))]

    def _force(self, memory: Memory) -> InForce | None:
        return model_in_force(self._model, memory, self._config.period_s, self._config.options)

    def _predict(self, part: Part) -> Prediction:
        frames, force = part.frames, self._in_force
        restart = restart_marks(
            frames, self._config.period_s, before_ns=self._last_ns, opens=part.opens
        )
        self._last_ns = int(frames.stamp_ns[-1])
        if force is None:
            self._state = self._model.initial_state()
        coefficients = force.coefficients if force is not None else None
        run = run_model(self._model, self._state, coefficients, frames, restart)
        return Prediction(
            cycle=part.number,
            stamp_ns=frames.stamp_ns,
            measured=frames.position,
            predicted=run.predicted,
            simulated=run.simulated,
            residual=residuals(frames, run),
            residual_sigma=force.residual_sigma if force is not None else np.nan,
            validity=run.validity,
            reproducible=part.ordinal not in self._early,
        )
