# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Cost that does not grow with the years: a verdict, a page, a store after very many cycles."""

from __future__ import annotations

import tempfile
import time
from functools import partial
from pathlib import Path
from statistics import median as middle
from typing import TYPE_CHECKING

import numpy as np
import sqlalchemy as sa

from valve_twin.bench.measure import Ratio, median
from valve_twin.core.aging import AgingConfig, assess
from valve_twin.core.past.columns import past_of
from valve_twin.core.past.state import AgingState
from valve_twin.core.types import Estimate, EstimateStatus, Parameter, ParameterValue
from valve_twin.io.history.database import Database
from valve_twin.io.history.insert import Insert
from valve_twin.io.history.store import CycleRecord, History
from valve_twin.io.history.tables import CYCLE, ESTIMATE, VALVE, estimate_row, to_row

if TYPE_CHECKING:
    from collections.abc import Iterator

    from valve_twin.bench.measure import Scale

_NAMES = ("gain_in", "gain_out", "leak")
_PARAMETERS = tuple(Parameter(name, "1", "", trend=True) for name in _NAMES)
_PERIOD_NS = 30 * 10**9
_YOUNG = 1000  # cycles that a history with little in it holds
_PAGE = 100
_VALVE = "/v"


def compare(scale: Scale) -> Iterator[Ratio]:
    """Yield the comparisons of this area."""
    yield from _verdicts(50_000 if scale.quick else 1_000_000, 3)
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
    bounded, everything = state.past(), past_of(life(cycles))
    young = past_of(life(_YOUNG))
    ours, peer, early = (
        median(partial(assess, p, (), AgingConfig(), parameters=_PARAMETERS), repeats)
        for p in (bounded, everything, young)
    )
    yield Ratio(f"verdict after cycle {cycles}", "one on every estimate", ours, peer, 1.0)
    late = f"verdict after cycle {cycles} against an early one"
    yield Ratio(late, f"one after cycle {_YOUNG}", ours, early, 0.2)
    loop = median(partial(sum, range(1_000_000)), repeats) * cycles / 1e6
    goal = 0.01 / 30.0  # a million in 30 s where the loop takes 10 ms
    yield Ratio(f"catching up on {cycles} cycles", "a sum over as many", adding, loop, goal)


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
            Insert(database, VALVE)(connection, [{"name": _VALVE}])
            valve_id = int(connection.execute(sa.select(VALVE.c.id)).scalar_one())
            insert_cycle, insert_estimate = Insert(database, CYCLE), Insert(database, ESTIMATE)
            for e in life(cycles):
                record = CycleRecord(e.cycle, e.start_ns, e.end_ns, 800)
                insert_cycle(connection, [to_row(record, valve_id)])
                insert_estimate(connection, [estimate_row(valve_id, 0, e)])
    finally:
        database.close()
