# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Cut a stream of frames into production cycles.

A cycle opens when its rule fires and closes when the next one opens; a cycle cut from the commands
also closes after a long idle time or at its greatest length, so that a night is not estimated. The
decision for a sample depends on the samples before it and on nothing else: any split of the stream
into blocks gives the same cycles.
"""

from __future__ import annotations

from collections import deque
from enum import Enum
from statistics import median
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.cycle_rules import (
    ARMED,
    LAST,
    OPEN,
    RUNNING,
    SEEN,
    WAS_HIGH,
    RuleState,
    column_of,
    has_returned,
    mark_changes,
    mark_commands,
    mark_reference,
    set_overdue,
)
from valve_twin.core.gaps import PERIOD_TOLERANCE, count_lost, extreme_steps, gap_ns
from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.state import Part, SegmenterState
from valve_twin.core.types import ByteArray, Cycle, CycleRule, Frames, IntArray, join_frames

if TYPE_CHECKING:
    from valve_twin.core.cycle_config import CycleConfig
    from valve_twin.core.state import Resume

MIN_SAMPLES = 8
"""Fewest samples handed to estimation; a regression of paper 002, eq. (17) needs more than 4."""

USUAL_SHARE = 0.9
"""Share of the usual length that a cycle needs in which the record ends (assumed)."""

_JOINED_PARTS = 32
"""Parts of a cycle that are joined on the way: samples that come singly are not all joined at its
end, where predictions would wait for it."""

_CUTS = {CycleRule.COUNTER: {"cycle_counter"}, CycleRule.REFERENCE: {"reference"}}

_USUAL_CYCLES = 20  # closed cycles whose median length is the usual one


class Closing(Enum):
    """Why a cycle was closed."""

    NEXT = "the next cycle began"
    LIMIT = "no command for idle_close_s, max_cycle_s reached, or overdue"
    ASKED = "closed on request"
    END = "closed at the end of the record"


class Segmenter:
    """Deterministic cutter: frames in, parts and closed cycles out.

    Parameters
    ----------
    config : CycleConfig
        The rule and its limits.
    inputs : tuple of str
        Signal names of the commands, in the column order of `Frames.inputs`.
    period_s : float
        Nominal sampling time of the position [s].
    last_cycle : int
        Number of the last stored cycle; numbering goes on from there.
    resumed : bool
        True when `last_cycle` comes from a history: what was missed in between is unknown unless a
        counter tells or the stream goes on where that cycle ended.
    resume : Resume, optional
        What is known beside the number.

    Raises
    ------
    ValueError
        If the rule names a command that the model does not have, or needs one and there is none.
    """

    def __init__(
        self,
        config: CycleConfig,
        inputs: tuple[str, ...],
        period_s: float,
        *,
        last_cycle: int = 0,
        resumed: bool = False,
        resume: Resume | None = None,
    ) -> None:
        if config.rule is CycleRule.COMMANDS and not inputs:
            msg = "cycles.rule: commands needs a command and this model has none"
            raise ValueError(msg)
        self._config = config
        self._period_s = period_s
        self._columns = np.array(
            [
                column_of(config.start_signal or "".join(inputs[:1]), inputs, "start_signal"),
                column_of(config.rearm_signal, inputs, "rearm_signal"),
            ],
            dtype=np.int64,
        )
        self._cut_by = _CUTS.get(config.rule, set())
        if config.rule is CycleRule.COMMANDS:
            self._cut_by = {inputs[i] for i in self._columns if i >= 0}
        limits = (config.min_cycle_s, config.max_cycle_s, config.idle_close_s, config.max_cycle_s)
        self._limits_ns = np.array([round(s * 1e9) for s in limits], dtype=np.int64)
        self._last_number = last_cycle
        self._missed_before = -1 if resumed else 0
        self._resume = resume
        self._first_ns: int | None = None
        self._begin_ns: int | None = None
        self._step_ns = round(gap_ns(period_s))
        self._inside = self._goes_on = False
        self._ordinal = 0
        self._counted_before = 0
        self._lengths: deque[int] = deque(maxlen=_USUAL_CYCLES)
        self._forget()

    def _forget(self) -> None:
        armed = self._config.rule is not CycleRule.REFERENCE
        self._clock, self._flags = RuleState(armed=armed).arrays()
        self._parts: list[Frames] = []
        self._loose: list[Frames] = []
        self._number = 0
        self._missed = 0
        self._reproducible = True
        self._late = self._late_ahead = ""

    @property
    def running(self) -> int:
        """Number of the running cycle, 0 between cycles."""
        return self._number

    def snapshot(self) -> SegmenterState:
        """Return the whole state; `restore` in a segmenter of equal configuration goes on."""
        parts = [*self._parts, *self._loose]
        return SegmenterState(
            rule=RuleState.of(self._clock, self._flags),
            frames=join_frames(parts) if parts else None,
            number=self._number,
            missed=self._missed,
            reproducible=self._reproducible,
            late=self._late,
            late_ahead=self._late_ahead,
            last_number=self._last_number,
            missed_before=self._missed_before,
            counted_before=self._counted_before,
            ordinal=self._ordinal,
            lengths=tuple(self._lengths),
            resume=self._resume,
            first_ns=self._first_ns,
            begin_ns=self._begin_ns,
            inside=self._inside,
            goes_on=self._goes_on,
        )

    def restore(self, state: SegmenterState) -> None:
        """Go on from a snapshot with the same bits."""
        self._clock, self._flags = state.rule.arrays()
        self._parts, self._loose = [] if state.frames is None else [state.frames], []
        self._number, self._missed = state.number, state.missed
        self._reproducible = state.reproducible
        self._late, self._late_ahead = state.late, state.late_ahead
        self._last_number, self._missed_before = state.last_number, state.missed_before
        self._counted_before, self._ordinal = state.counted_before, state.ordinal
        self._lengths = deque(state.lengths, maxlen=_USUAL_CYCLES)
        set_overdue(self._limits_ns, self._lengths, self._period_s)
        self._resume = state.resume
        self._first_ns, self._begin_ns = state.first_ns, state.begin_ns
        self._inside, self._goes_on = state.inside, state.goes_on

    def reset(self) -> None:
        """Drop the running cycle (clock jump); numbering goes on, missed cycles are unknown."""
        self._forget()
        self._missed_before = -1
        self._first_ns = 0 if self._first_ns is None else self._first_ns
        self._begin_ns = None
        self._inside = self._goes_on = False

    def begin_anew(self, last_cycle: int, resume: Resume | None) -> None:
        """Drop the running cycle and begin as after a restart; see the class."""
        self._forget()
        self._last_number, self._missed_before = last_cycle, -1 if last_cycle else 0
        self._resume, self._first_ns, self._begin_ns = resume, None, None
        self._inside = self._goes_on = False

    def number_from(self, last_cycle: int) -> None:
        """Give the cycles to come numbers above `last_cycle`."""
        self._last_number = max(self._last_number, last_cycle)

    def mark_irreproducible(self) -> None:
        """Note that the running cycle lost or guessed input."""
        self._reproducible = False

    def mark_late(self, signals: set[str]) -> None:
        """Note that frames guessed these signals, as samples came too late.

        The running cycle is refused where one of them cuts the cycles, and so is one that the
        next frames open: its begin is no less guessed.
        """
        self._reproducible = False
        if not self._cut_by.isdisjoint(signals):
            self._late = self._late_ahead = ", ".join(sorted(self._cut_by & signals))

    def push(self, frames: Frames) -> list[Part | Cycle]:
        """Cut frames.

        Parameters
        ----------
        frames : Frames
            The next N frames of the stream, N >= 1.

        Returns
        -------
        list of Part or Cycle
            In stream order; a `Cycle` follows its last part.
        """
        if self._begin_ns is None:
            self._begin_ns = int(frames.stamp_ns[0])
        if self._resume is not None:
            stored = self._skip_stored(frames)
            if stored:
                before = [Part(frames[:stored], self._ordinal, 0, opens=False)]
                return [*before, *(self.push(frames[stored:]) if stored < len(frames) else [])]
        late, self._late_ahead = self._late_ahead, ""
        out: list[Part | Cycle] = []
        begin = judged = 0
        opens = False
        while judged < len(frames):
            marks, more = self._mark(frames, judged)
            for mark in marks.nonzero()[0].tolist():
                at = judged + mark
                if at > begin:
                    out.append(self._extend(frames[begin:at], opens=opens))
                opens = bool(marks[mark] == OPEN)
                out += self._close(Closing.NEXT if opens else Closing.LIMIT)
                if opens:
                    self._open(frames, at)
                    self._late = late
                begin = at
            judged += more
        out.append(self._extend(frames[begin:] if begin else frames, opens=opens))
        return out

    def close(self, why: Closing) -> list[Cycle]:
        """Close the running cycle now, if there is one."""
        cycles = self._close(why)
        self._flags[RUNNING] = 0
        return cycles

    def _mark(self, frames: Frames, begin: int) -> tuple[ByteArray, int]:
        """Return the marks of the frames from one on that were judged, and how many those are."""
        stamp_ns = frames.stamp_ns[begin:]
        marks = np.zeros(len(stamp_ns), dtype=np.uint8)
        judged = len(stamp_ns)
        config = self._config
        if config.rule is CycleRule.COMMANDS:
            judged = mark_commands(
                stamp_ns,
                frames.inputs[begin:],
                self._columns,
                self._limits_ns,
                config.threshold,
                config.rearm_threshold,
                self._clock,
                self._flags,
                marks,
            )
        elif config.rule is CycleRule.REFERENCE:
            low = config.reference_level - config.reference_hysteresis
            mark_reference(
                stamp_ns,
                frames.reference[begin:],
                self._limits_ns,
                low,
                config.reference_level,
                self._clock,
                self._flags,
                marks,
            )
        else:
            keys, known = self._keys(frames[begin:])
            mark_changes(keys, known, self._clock, self._flags, marks)
        return marks[:judged], judged

    def _keys(self, frames: Frames) -> tuple[IntArray, ByteArray]:
        if self._config.rule is CycleRule.WINDOW:
            offset_ns = round(self._config.window_offset_s * 1e9)
            keys = (frames.stamp_ns - offset_ns) // round(self._config.window_s * 1e9)
            return keys, np.ones(len(frames), dtype=np.uint8)
        known = np.isfinite(frames.counter)
        return np.where(known, frames.counter, 0.0).astype(np.int64), known.astype(np.uint8)

    def _open(self, frames: Frames, at: int) -> None:
        if self._resume is not None:
            self._go_on(self._resume, int(frames.stamp_ns[at]))
        previous = self._last_number
        self._number = previous + 1
        self._missed = self._missed_before
        if self._config.rule is CycleRule.COUNTER:
            self._number, self._missed = self._count(int(frames.counter[at]))
        self._missed_before = 0
        self._last_number = self._number
        self._ordinal += 1

    def _skip_stored(self, frames: Frames) -> int:
        """Return how many of the frames belong to the last stored cycle, given once more.

        Where the stream begins elsewhere inside a cycle, its rest is not taken for a whole one.
        """
        last = self._resume
        assert last is not None
        if self._first_ns is None:
            self._first_ns = first_ns = int(frames.stamp_ns[0])
            self._inside = last.start_ns <= first_ns <= last.end_ns
            self._goes_on = last.start_ns <= first_ns <= last.end_ns + self._step_ns
            again = last.end_ns < last.start_ns and first_ns <= last.announced.start_ns
            if not self._goes_on and not again:
                self._start_late(frames)
        if not self._inside:
            return 0
        stored = int(np.searchsorted(frames.stamp_ns, last.end_ns, side="right"))
        if stored:
            judged = 0
            while judged < stored:
                judged += self._mark(frames[:stored], judged)[1]
            self._flags[RUNNING] = 0
        self._inside = stored == len(frames)
        if not self._inside and self._config.rule is CycleRule.COMMANDS:
            self._flags[ARMED] = 1
        return stored

    def _start_late(self, frames: Frames) -> None:
        self._flags[WAS_HIGH], self._flags[ARMED] = 1, 0
        if self._config.rule in {CycleRule.COUNTER, CycleRule.WINDOW}:
            keys, known = self._keys(frames)
            if known.any():
                self._clock[LAST], self._flags[SEEN] = keys[np.argmax(known)], 1

    def _go_on(self, last: Resume, start_ns: int) -> None:
        """Take up the numbering at the first cycle after a restart."""
        if self._goes_on and start_ns > last.end_ns:
            self._missed_before = 0
        if start_ns > last.announced.start_ns:
            self._last_number = max(self._last_number, last.announced.number)
            self._resume = None
        self._goes_on = False

    def _count(self, counter: int) -> tuple[int, int]:
        """Return number and missed cycles of a cycle with that counter.

        A counter that starts again goes on counting from the last number, which never repeats.
        """
        previous, number = self._last_number, counter + self._counted_before
        if number < previous:
            self._counted_before = previous + 1 - counter
            return previous + 1, -1
        gap = number - previous - 1
        fresh = previous == 0 and self._missed_before == 0
        return number, 0 if fresh else max(gap, -1)

    def _extend(self, frames: Frames, *, opens: bool) -> Part:
        if self._number:
            self._loose.append(frames)
            if len(self._loose) >= _JOINED_PARTS:
                self._parts.append(join_frames(self._loose))
                self._loose = []
        return Part(frames, self._ordinal, self._number, opens)

    def _close(self, why: Closing) -> list[Cycle]:
        if not self._number:
            return []
        frames = join_frames([*self._parts, *self._loose])
        steps = extreme_steps(frames.stamp_ns)
        gaps = steps[1] > gap_ns(self._period_s)
        lost = count_lost(frames.stamp_ns, self._period_s) if gaps else 0
        problem = (
            self._too_short(frames, why)
            or self._off_period(frames.stamp_ns, steps)
            or self._cut_late()
        )
        cycle = Cycle(
            number=self._number,
            period_s=self._period_s,
            frames=frames,
            lost=lost,
            missed_cycles=self._missed,
            accepted=not problem,
            reason=Refusal(problem.code, f"{problem}; {why.value}") if problem else why.value,
            reproducible=self._reproducible and lost == 0,
        )
        self._parts, self._loose, self._number, self._reproducible = [], [], 0, True
        return [cycle]

    def _off_period(self, stamp_ns: IntArray, steps: tuple[int, int]) -> Refusal | None:
        """Say that the sampling time is not the configured one, None if it is."""
        tolerance = PERIOD_TOLERANCE * self._period_s
        least, most = steps
        if len(stamp_ns) > 1 and (
            max(self._period_s - 1e-9 * least, 1e-9 * most - self._period_s) <= tolerance
        ):
            return None  # where no step is off, neither is the median, which costs more
        step_s = 1e-9 * float(np.median(np.diff(stamp_ns)))
        if abs(step_s - self._period_s) <= tolerance:
            return None
        text = (
            f"the stamps are {step_s:.4g} s apart (median) but period_s is "
            f"{self._period_s:g} s: correct period_s"
        )
        return Refusal(RefusalCode.WRONG_PERIOD, text)

    def _cut_late(self) -> Refusal | None:
        """Say which signal came too late to cut the cycle, None if none did."""
        if not self._late:
            return None
        text = (
            f"samples of {self._late}, which cuts the cycles, came later than hold_back_s allows: "
            "synchronise the clocks or raise hold_back_s"
        )
        return Refusal(RefusalCode.LATE, text)

    def _too_short(self, frames: Frames, why: Closing) -> Refusal | None:
        """Say why a cycle of so few samples cannot be estimated, None if it can."""
        samples = len(frames)
        usual = float(median(self._lengths)) if self._lengths else 0.0
        if why is not Closing.END:
            self._lengths.append(samples)
            set_overdue(self._limits_ns, self._lengths, self._period_s)
        elif samples < USUAL_SHARE * usual and not has_returned(frames):
            text = f"cut off: {samples} samples of the usual {usual:.0f}"
            return Refusal(RefusalCode.CYCLE_TOO_SHORT, text)
        if samples >= MIN_SAMPLES:
            return None
        return Refusal(RefusalCode.CYCLE_TOO_SHORT, f"{samples} samples, fewer than {MIN_SAMPLES}")
