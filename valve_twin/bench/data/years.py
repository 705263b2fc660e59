# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Cost that does not grow with the years: a verdict, a page, a store after very many cycles."""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from functools import partial
from itertools import zip_longest
from pathlib import Path
from statistics import median as middle
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.bench.measure import Ratio, median
from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.aging.cutting.ahead import look_ahead
from valve_twin.core.aging.cutting.memory import Memory
from valve_twin.core.diagnosis.features import ESTIMATOR as FEATURES
from valve_twin.core.diagnosis.watch.memory import Known
from valve_twin.core.past.columns import past_of
from valve_twin.core.past.state import AgingState
from valve_twin.core.past.stored import freeze
from valve_twin.core.types import Estimate, EstimateStatus, Parameter, ParameterValue
from valve_twin.core.valves.press_cartridge import MODEL
from valve_twin.io.history.aging.file import load, origin_of, pack, write
from valve_twin.io.history.database import Database
from valve_twin.io.history.fleet import rank_fleet
from valve_twin.io.history.insert import Insert
from valve_twin.io.history.store import CycleRecord, History
from valve_twin.io.history.tables import CYCLE, ESTIMATE, estimate_row, to_row
from valve_twin.io.history.valves.names import key_of
from valve_twin.report.build import history_data
from valve_twin.report.page import render_report

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from valve_twin.bench.measure import Scale
    from valve_twin.core.aging.assess import Assessment
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.past.columns import Past
    from valve_twin.core.types import FloatArray

_NAMES = ("gain_in", "gain_out", "leak")
_PARAMETERS = tuple(Parameter(name, "1", "", trend=True) for name in _NAMES)
_PERIOD_NS = 30 * 10**9
_YOUNG = 1000  # cycles that a history with little in it holds
_FEATURED = 10_000  # cycles whose features are not all kept: up to 4096 are
_FAULTY, _ONSETS, _LONG = 3000, (400, 900, 1400, 1900, 2400), 60  # cycles, and those with a fault
_BEGINNINGS, _LEAKS = 5, 2  # and the signature that they show, a leak of 9e-4
_PAGE = 100
_VALVE = "/v"
_IN_A_ROW = 70  # verdicts: some searches ahead of a long trend are among them
_CONFIG = AgingConfig()


def compare(scale: Scale) -> Iterator[Ratio]:
    """Yield the comparisons of this area."""
    yield from _verdicts(50_000 if scale.quick else 1_000_000, 3)
    yield from _ranked(5_000 if scale.quick else 30_000, scale.repeats)
    yield from _stored(5_000 if scale.quick else 300_000, 40 * scale.repeats)


def life(cycles: int, first: int = 1) -> Iterator[Estimate]:
    """Yield estimates of three parameters that wear by 2 % in a million cycles.

    Parameters
    ----------
    cycles : int
        How many [1].
    first : int
        Number of the first cycle [1].
    """
    random = np.random.default_rng(first)
    for cycle in range(first, first + cycles):
        values = 1.0 + 2e-8 * cycle + 1e-3 * random.standard_normal(len(_NAMES))
        start_ns = cycle * _PERIOD_NS
        yield Estimate(
            model="press_cartridge",
            estimator="output_error",
            cycle=cycle,
            start_ns=start_ns,
            end_ns=start_ns + 25 * 10**9,
            parameters=tuple(
                ParameterValue(n, v, standard_error=1e-3, lower_95=v - 2e-3, upper_95=v + 2e-3)
                for n, v in zip(_NAMES, values.tolist(), strict=True)
            ),
            status=EstimateStatus.ACCEPTED,
            reason="",
            used_by_trend=True,
        )


def features(
    cycles: int, first: int = 1, *, wrong: FloatArray | float = 0.0
) -> Iterator[Estimate]:
    """Yield what a press valve shows beside `life`, scattering as the table of its faults says.

    Parameters
    ----------
    cycles : int
        How many [1].
    first : int
        Number of the first cycle [1].
    wrong : (F,) array or float
        By how much they are changed [as followed].
    """
    table, kind = _table(), MODEL.feature_set
    random = np.random.default_rng(first)
    rows = random.multivariate_normal(np.zeros(len(kind.names)), table.covariance, cycles) + wrong
    relative = np.isin(kind.names, sorted(kind.relative))
    values = np.where(relative, np.exp(rows), rows).tolist()
    for estimate, row in zip(life(cycles, first), values, strict=True):
        parameters = map(ParameterValue, kind.names, row)
        yield replace(
            estimate,
            estimator=FEATURES,
            parameters=tuple(parameters),
            status=EstimateStatus.PARTIAL,
            used_by_trend=False,
        )


def _table() -> SignatureTable:
    """Return the table of the faults of a press valve."""
    table = MODEL.signatures()
    assert table is not None
    return table


def _verdicts(cycles: int, repeats: int) -> Iterator[Ratio]:
    """Compare a verdict on what is kept with one on every estimate, and the two ways to keep."""
    begin = time.process_time()
    for _ in life(cycles):
        pass
    making = time.process_time() - begin
    state = AgingState()
    begin = time.process_time()
    for estimate in life(cycles):
        state.add(estimate)
    adding = time.process_time() - begin - making
    everything, young = past_of(life(cycles)), AgingState()
    for estimate in life(_YOUNG):
        young.add(estimate)
    peer = median(partial(_assess, everything), repeats)
    memory = Memory()
    ours, longest = _goes_on(state, memory, cycles)
    early, _ = _goes_on(young, Memory(), _YOUNG)
    yield Ratio(f"verdict after cycle {cycles}", "one on every estimate", ours, peer, 5.0)
    longest_of = f"longest of {_IN_A_ROW} in a row"
    yield Ratio(longest_of, "one on every estimate", longest, peer, 3.0)
    late = f"verdict after cycle {cycles} against an early one"
    yield Ratio(late, f"one after cycle {_YOUNG}", ours, early, 0.3)
    yield from _with_features()
    begun = median(partial(_begin_again, state, memory), repeats)
    yield Ratio("state stored and read, first verdict", longest_of, begun, longest, 0.3)
    loop = median(partial(sum, range(1_000_000)), repeats) * cycles / 1e6
    goal = 0.01 / 30.0  # a million in 30 s where the loop takes 10 ms
    yield Ratio(f"catching up on {cycles} cycles", "a sum over as many", adding, loop, goal)


def _with_features() -> Iterator[Ratio]:
    """Compare verdicts that rest on features, too, with early ones and with judging all anew."""
    taken = []
    for cycles, again in ((_YOUNG, False), (_FEATURED, False), (_FEATURED, True)):
        state = AgingState()
        for estimates in zip(life(cycles), features(cycles), strict=True):
            for estimate in estimates:
                state.add(estimate)
        taken.append(_goes_on(state, Memory(), cycles, features, anew=again)[0])
    what = f"verdict with features after cycle {_FEATURED}"
    yield Ratio(what, f"one after cycle {_YOUNG}", taken[1], taken[0], 0.3)
    anew = "one that judges all features anew"
    yield Ratio(f"{what}, each judged once", anew, taken[1], taken[2], 2.0)
    begun = middle(map(_begins_with_faults, range(_BEGINNINGS)))
    loop = median(partial(sum, range(1_000_000)), _BEGINNINGS)
    name = f"state with {len(_ONSETS)} faults that are over, first verdict"
    yield Ratio(name, "a sum over 1000000", begun, loop, 0.1)  # 0.1 s where the loop takes 10 ms


def _begins_with_faults(number: int) -> float:
    """Return what reading a state and its first verdict take, after faults that are over [s]."""
    wrong = np.zeros((_FAULTY, len(MODEL.feature_set.names)))
    for onset in _ONSETS:
        wrong[onset : onset + _LONG] += _table().signatures[_LEAKS].change
    first = 1 + number * _FAULTY  # other features each time, which no process has seen
    state, memory = AgingState(), Memory()
    shown = features(_FAULTY, first, wrong=wrong)
    for estimates in zip(life(_FAULTY, first), shown, strict=True):
        for estimate in estimates:
            state.add(estimate)
    past = state.past()
    _assess(replace(past, features=past.features.take(np.arange(0))), memory)
    origin = origin_of(_VALVE, "press_cartridge")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "known"
        write(path, pack(freeze(state), memory, {}, origin, _CONFIG))
        begin = time.process_time()
        known = load(path, origin, _CONFIG)
        assert known is not None
        found = _assess(known.state.past(), known.memory).diagnosis.findings
        taken = time.process_time() - begin
    assert sum(f.end >= 0 for f in found) == len(_ONSETS), found
    return taken


def _assess(past: Past, memory: Memory | None = None) -> Assessment:
    return assess(past, (), _CONFIG, parameters=_PARAMETERS, memory=memory)


def _goes_on(
    state: AgingState,
    memory: Memory,
    cycles: int,
    beside: Callable[[int, int], Iterator[Estimate]] = lambda *_: iter(()),
    *,
    anew: bool = False,
) -> tuple[float, float]:
    """Return what the verdicts of the next cycles take, their median and the longest [s].

    What is searched ahead is searched between them, as a monitor does; where `anew`, what
    features showed before is not remembered.
    """
    taken = []
    _assess(state.past(), memory)
    shown = zip_longest(life(_IN_A_ROW, cycles + 1), beside(_IN_A_ROW, cycles + 1))
    for estimates in shown:
        for estimate in filter(None, estimates):
            state.add(estimate)
        past = state.past()
        if anew:
            memory.faults = Known()
        begin = time.process_time()
        _assess(past, memory)
        taken.append(time.process_time() - begin)
        look_ahead(past, (), _CONFIG, parameters=_PARAMETERS, memory=memory)
    return middle(taken), max(taken)


def _begin_again(state: AgingState, memory: Memory) -> None:
    """Store what a monitor knows, read it and give a verdict."""
    origin = origin_of(_VALVE, "press_cartridge")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "known"
        write(path, pack(freeze(state), memory, {}, origin, _CONFIG))
        known = load(path, origin, _CONFIG)
    assert known is not None
    _assess(known.state.past(), known.memory)


def _ranked(cycles: int, repeats: int) -> Iterator[Ratio]:
    """Compare ranking a valve again, one cycle later, with ranking it the first time."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "fleet.db"
        _fill(path, cycles)
        first, again = 0.0, []
        for k in range(repeats + 1):
            with History(path) as history:
                (estimate,) = life(1, cycles + 1 + k)
                record = CycleRecord(estimate.cycle, estimate.start_ns, estimate.end_ns, 800)
                history.store(_VALVE, record, [estimate])
                begin = time.process_time()
                rank_fleet(history)
                taken = time.process_time() - begin
            if k:
                again.append(taken)
            else:
                first = taken
        what = f"fleet of a valve of {cycles} cycles, again"
        yield Ratio(what, "the first time", middle(again), first, 5.0)
        with History(path, read_only=True) as history:
            reading = median(partial(history.estimates, _VALVE), repeats)
            page = median(partial(_report, history), repeats)
        yield Ratio(f"report of a valve of {cycles} cycles", "reading them", page, reading, 0.5)


def _report(history: History) -> None:
    """Make the page of the valve from its history."""
    render_report(history_data(history, _VALVE, _CONFIG))


def _stored(cycles: int, repeats: int) -> Iterator[Ratio]:
    """Compare pages and stores of a long history with those of a short one; stores take turns."""
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / name for name in ("old.db", "young.db")]
        for path, number in zip(paths, (cycles, _YOUNG), strict=True):
            _fill(path, number)
        with History(paths[0]) as old, History(paths[1]) as young:
            ours, peer = (
                median(partial(h.estimates, _VALVE, "output_error", n // 2, _PAGE), repeats)
                for h, n in ((old, cycles), (young, _YOUNG))
            )
            yield Ratio(f"page of {_PAGE} of {cycles}", f"of {_YOUNG}", ours, peer, 0.5)
            both = ((old, cycles, list[float]()), (young, _YOUNG, list[float]()))
            for k in range(repeats):
                for history, n, taken in both[:: 1 - 2 * (k % 2)]:
                    (estimate,) = life(1, n + 1 + k)
                    record = CycleRecord(estimate.cycle, estimate.start_ns, estimate.end_ns, 800)
                    begin = time.perf_counter()
                    history.store(_VALVE, record, [estimate])
                    taken.append(time.perf_counter() - begin)
            late, early = middle(both[0][2]), middle(both[1][2])
            what = f"store of a cycle after {cycles}"
            yield Ratio(what, f"after {_YOUNG}", late, early, 1.0 / 1.1)


def _fill(path: Path, cycles: int) -> None:
    """Make a history of so many cycles, many in one transaction."""
    database = Database(str(path))
    try:
        with database.write() as connection:
            valve_id = key_of(connection, _VALVE, database.where)
            insert_cycle, insert_estimate = Insert(database, CYCLE), Insert(database, ESTIMATE)
            for e in life(cycles):
                record = CycleRecord(e.cycle, e.start_ns, e.end_ns, 800)
                insert_cycle(connection, [to_row(record, valve_id)])
                insert_estimate(connection, [estimate_row(valve_id, 0, e)])
    finally:
        database.close()
