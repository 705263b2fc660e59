# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Drive the twin from a recorded bag: the same core step as the live node, without ROS."""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.assess import Assessment, assess
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.gaps import count_paused
from valve_twin.core.operation.counters import Counters, cycle_duty
from valve_twin.core.prediction import fit_percent
from valve_twin.core.quantity import listed
from valve_twin.core.signal_clocks import ClockOffset, SignalClocks
from valve_twin.core.twin import Estimated, Event
from valve_twin.core.types import Cycle, Estimate, EstimateStatus, Prediction, join_blocks
from valve_twin.core.valves.registry import get_model
from valve_twin.io.bags.read import SLICE_S, read_signals
from valve_twin.io.history.tables import CycleRecord, cycle_record
from valve_twin.io.offline.large_rounds import LARGE_S, in_large_rounds
from valve_twin.io.offline.make_twin import make_twin
from valve_twin.io.offline.sources import NOT_MEASURED, cycle_files
from valve_twin.io.tables.json_lines import FILES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    from valve_twin.core.alignment import SignalCounts
    from valve_twin.core.twin import Twin
    from valve_twin.core.types import Frames, IntArray
    from valve_twin.io.bags.contents import BagInfo
    from valve_twin.io.cdr.signals import SignalBlock
    from valve_twin.io.config.valve import ValveConfig

_REASONS = 3  # told of refused cycles

COMPARED = 5
"""Newest cycles on which a model is compared with its baselines."""


@dataclass(slots=True)
class Record:
    """What an offline run found, in the order of the record.

    Attributes
    ----------
    cycles : list of CycleRecord
        Every closed cycle, refused ones included.
    estimates : list of Estimate
        Every estimator's estimate of every cycle.
    predictions : list of Prediction
        Predictions of the last cycle that was closed.
    trivial_fits : dict
        By cycle, the fit [%] of the trivial model "position = command" where there is one command.
    counts : dict
        What happened to the samples, by signal.
    newest : deque of Cycle
        The last cycles that were handed to estimation, with their samples.
    paused : int
        How many of the samples that the cycles lack are missing in pauses of the recording.
    offsets : list of ClockOffset
        How far the clocks of the signals run apart.
    normalised : bool
        Whether positions are shares of the stroke.
    driven : list of int
        Columns of the inputs that the model's free run is computed from.
    counters : Counters
        What the valve did.
    files : dict
        By cycle, the imported files that it comes from; empty = the bag was not imported.
    """

    cycles: list[CycleRecord] = field(default_factory=list)
    estimates: list[Estimate] = field(default_factory=list)
    predictions: list[Prediction] = field(default_factory=list)
    trivial_fits: dict[int, float] = field(default_factory=dict)
    counts: dict[str, SignalCounts] = field(default_factory=dict)
    newest: deque[Cycle] = field(default_factory=lambda: deque(maxlen=COMPARED + 1))
    paused: int = 0
    offsets: list[ClockOffset] = field(default_factory=list)
    normalised: bool = False
    driven: list[int] = field(default_factory=list)
    counters: Counters = field(default_factory=Counters)
    files: dict[int, tuple[str, ...]] = field(default_factory=dict)
    _running: dict[int, list[Prediction]] = field(default_factory=dict)

    def add(self, event: Event) -> None:
        """Take one event of the twin."""
        if isinstance(event, Prediction):
            if event.cycle:
                self._running.setdefault(event.cycle, []).append(event)
        elif isinstance(event, Cycle):
            self.cycles.append(cycle_record(event))
            duty = cycle_duty(event, normalised=self.normalised)
            self.counters = self.counters if duty is None else self.counters.after(duty)
            self.paused += count_paused(event.frames.stamp_ns, event.period_s) if event.lost else 0
        elif isinstance(event, Estimated):
            self.estimates += event.estimates
            self.newest.append(event.cycle)
            self.trivial_fits[event.cycle.number] = trivial_fit(event.cycle.frames)
            self._keep_last()

    @property
    def last(self) -> Cycle | None:
        """The last cycle that was handed to estimation, with its samples."""
        return self.newest[-1] if self.newest else None

    def close(self) -> None:
        """Settle which predictions belong to the last closed cycle."""
        self._keep_last()

    def _keep_last(self) -> None:
        closed = {c.cycle for c in self.cycles[-3:] if c.accepted}
        ready = [n for n in self._running if n in closed]
        if ready:
            last = max(ready)
            self.predictions = self._running[last]
            open_or_last = [n for n in self._running if n >= last or n not in closed]
            self._running = {n: self._running[n] for n in open_or_last}


def trivial_fit(frames: Frames) -> float:
    """Return the free-run fit [%] of "position = command", NaN where there is not one command."""
    if frames.inputs.shape[1] != 1:
        return float("nan")
    valid = frames.valid
    return fit_percent(frames.position[valid], frames.inputs[valid, 0])


def join_predictions(parts: list[Prediction]) -> Prediction | None:
    """Join the predictions of one cycle, None where there are none."""
    return join_blocks(parts) if parts else None


def drive(
    twin: Twin,
    config: ValveConfig,
    rounds: Iterable[Sequence[SignalBlock]],
    *,
    close_last: bool = True,
    freeze_after: int = 0,
) -> Iterator[Event]:
    """Push signals through a twin and estimate in between.

    Parameters
    ----------
    twin : Twin
        The twin of the valve.
    config : ValveConfig
        Its configuration.
    rounds : iterable of sequence of SignalBlock
        Samples in the order in which they were recorded; those of one round together.
    close_last : bool
        Close the cycle in which the record ends; the live node cannot know that it has ended.
    freeze_after : int
        The cycle after which nothing more is learnt: later ones are estimated and judged by the
        model that was in force then; 0 = none.

    Yields
    ------
    Event
        In stream order.
    """
    model = get_model(config.model)
    options = config.options

    def settle(events: list[Event]) -> Iterator[Event]:
        yield from events
        while (job := twin.next_job()) is not None:
            estimates, memory = estimate_cycle(model, options, job.cycle, job.memory)
            frozen = 0 < freeze_after < job.cycle.number
            yield from twin.deliver(estimates, job.memory if frozen else memory)

    for parts in rounds:
        if len(parts) == 1:
            (block,) = parts
            events = twin.push(block.signal, block.stamp_ns, block.values, header=block.has_header)
        else:
            events = twin.push_round((b.signal, b.stamp_ns, b.values) for b in parts)
        yield from settle(events)
    if close_last:
        yield from settle(twin.finish())


def estimate_bag(
    config: ValveConfig,
    bag: str | Path,
    *,
    close_last: bool = True,
    twin: Twin | None = None,
    freeze_after: int = 0,
    clocks: SignalClocks | None = None,
    on_open: Callable[[BagInfo], None] = lambda _: None,
) -> Iterator[Event]:
    """Estimate every cycle of a bag.

    Parameters
    ----------
    config : ValveConfig
        The valve's configuration.
    bag : path
        Folder, metadata.yaml or .mcap file.
    close_last : bool
        See `drive`.
    twin : Twin, optional
        The twin to drive, default a new one.
    freeze_after : int
        See `drive`.
    clocks : SignalClocks, optional
        Is told how far the stamps are ahead of the record.
    on_open : callable
        Is told what the bag holds.

    Yields
    ------
    Event
        In stream order.

    Raises
    ------
    BagError
        If the bag cannot be read or lacks a topic.
    ConfigError
        If the configuration does not fit.
    """
    twin = make_twin(config) if twin is None else twin
    position = get_model(config.model).output
    # the position comes last in each round of blocks: the commands it needs are then there
    sources = sorted(config.signals.values(), key=lambda s: s.signal == position)
    rounds = in_large_rounds(
        _noted(read_signals(bag, sources, slice_s=LARGE_S, on_open=on_open), clocks),
        [source.signal for source in sources],
        hold_back_s=config.hold_back_s,
        slice_s=SLICE_S,
    )
    return drive(twin, config, rounds, close_last=close_last, freeze_after=freeze_after)


def run_bag(
    config: ValveConfig,
    bag: str | Path,
    *,
    close_last: bool = True,
    predict: bool = True,
    freeze_after: int = 0,
    on_cycle: Callable[[], None] = lambda: None,
) -> Record:
    """Estimate every cycle of a bag and keep what was found.

    Parameters
    ----------
    config : ValveConfig
        The valve's configuration.
    bag : path
        Folder, metadata.yaml or .mcap file.
    close_last : bool
        See `drive`.
    predict : bool
        Predict every sample; the estimates do not need it.
    freeze_after : int
        See `drive`.
    on_cycle : callable
        Called after each cycle.

    Returns
    -------
    Record
        Cycles, estimates, the last cycle's predictions, and what happened to the samples.

    Raises
    ------
    BagError
        If the bag cannot be read or lacks a topic.
    ConfigError
        If the configuration does not fit.
    """
    twin = make_twin(config)
    twin.predicts = predict
    model = get_model(config.model)
    driven = [model.inputs.index(name) for name in model.driven_by or model.inputs]
    record = Record(normalised=model.normalised, driven=driven)
    clocks = SignalClocks(get_model(config.model).output, config.hold_back_s, looks=1)
    opened: list[BagInfo] = []
    events = estimate_bag(
        config,
        bag,
        close_last=close_last,
        twin=twin,
        freeze_after=freeze_after,
        clocks=clocks,
        on_open=opened.append,
    )
    for event in events:
        record.add(event)
        if isinstance(event, Cycle):
            on_cycle()
    record.close()
    record.counts = twin.counts()
    record.offsets = clocks.look()
    record.files = cycle_files(config, opened[0], record.cycles)
    return record


def _noted(blocks: Iterable[SignalBlock], clocks: SignalClocks | None) -> Iterator[SignalBlock]:
    """Hand blocks on and note in the end by how much their stamps are ahead of the record."""
    newest: dict[str, tuple[SignalBlock, IntArray]] = {}
    for block in blocks:
        if block.log_ns is not None and len(block.log_ns):
            newest[block.signal] = block, block.log_ns
        yield block
    if clocks is None:
        return
    for block, log_ns in newest.values():
        ahead_ns = float(np.median(block.stamp_ns - log_ns))
        clocks.note(block.signal, ahead_ns, has_header=block.has_header)


def describe_bad(config: ValveConfig, bag: str | Path, record: Record) -> list[str]:
    """Return one line a signal of which samples were left out: topic, how many, what to do.

    Parameters
    ----------
    config : ValveConfig
        The valve's configuration.
    bag : path
        What was read, for the lines.
    record : Record
        What was found.
    """
    lines = [f"{bag}: {offset}" for offset in record.offsets]
    if not config.csv.times_measured:
        lines.append(f"{bag}: {NOT_MEASURED}")
    for signal, counts in record.counts.items():
        source = config.signals[signal]
        where = f"{bag}: topic '{source.topic}': of {counts.received} values"
        if counts.bad:
            lines.append(
                f"{where} {counts.bad} are not finite or outside "
                f"{source.lower:g} .. {source.upper:g}; they were left out: check the sensor, "
                f"or signals.{signal}.lower and .upper"
            )
        if counts.late:
            lines.append(
                f"{where} {counts.late} came later than hold_back_s = {config.hold_back_s:g}; "
                "they were left out: raise hold_back_s"
            )
    return lines


def describe_refused(bag: str | Path, record: Record) -> list[str]:
    """Return one line a kind of refusal, with its first reason, the most frequent kind first."""
    trended = [e for e in record.estimates if e.used_by_trend]
    refused = [e for e in trended if e.status is EstimateStatus.REFUSED]
    first = {e.reason_code: e.reason for e in reversed(refused)}
    return [
        f"{bag}: {count} of {len(trended)} cycles give no estimate"
        f"{_of_files(record, refused, code)}: {first[code]}"
        for code, count in Counter(e.reason_code for e in refused).most_common(_REASONS)
    ]


def _of_files(record: Record, refused: list[Estimate], code: str) -> str:
    """Name the imported files of refused cycles where these are not of all files."""
    found = [record.files.get(e.cycle, ()) for e in refused if e.reason_code == code]
    names, known = (
        list(dict.fromkeys(name for names in of for name in names))
        for of in (found, record.files.values())
    )
    if not names or len(names) == len(known):
        return ""
    return f" ({listed(names, FILES)})"


def assess_record(config: ValveConfig, record: Record) -> Assessment:
    """Return trends and verdict of everything an offline run found."""
    parameters = get_model(config.model).parameters
    return assess(record.estimates, (), config.aging, parameters=parameters, valve=config.name)
