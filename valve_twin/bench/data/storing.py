# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The durable store of a cycle against bare SQLite."""

from __future__ import annotations

import json
import sqlite3
import tempfile
import time
from contextlib import closing
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

from valve_twin.bench.measure import Ratio, Scale
from valve_twin.core.types import Estimate, EstimateStatus, ParameterStatus, ParameterValue
from valve_twin.io.history.store import CycleRecord, History
from valve_twin.io.history.tables import estimate_row, to_row

if TYPE_CHECKING:
    from collections.abc import Iterator

ESTIMATORS = ("output_error", "equation_error_qp4")


def compare(scale: Scale) -> Iterator[Ratio]:
    """Yield the comparisons of this area."""
    yield _store(40 * scale.repeats)


def _store(cycles: int) -> Ratio:
    """Make a cycle durable: ours against sqlite3 alone, the same text in one row; elapsed time.

    Both flush to the disk with every cycle (WAL, synchronous=FULL). They take turns, because the
    time of a flush drifts. Making the text is part of both.
    """
    with tempfile.TemporaryDirectory() as folder:
        bare = sqlite3.connect(Path(folder) / "bare.sqlite", isolation_level=None)
        with closing(bare), History(Path(folder) / "ours.sqlite") as history:
            bare.execute("PRAGMA journal_mode=WAL")
            bare.execute("PRAGMA synchronous=FULL")
            bare.execute("CREATE TABLE cycle (cycle INTEGER PRIMARY KEY, content TEXT)")
            ours, peer = [], []
            for cycle in range(1, cycles + 1):
                record, estimates = _record(cycle)
                begin = time.perf_counter()
                history.store("/v", record, estimates)
                between = time.perf_counter()
                _store_bare(bare, record, estimates)
                end = time.perf_counter()
                ours.append(between - begin)
                peer.append(end - between)
            _require_same(history, bare)
    return Ratio("durable store of a cycle", "bare SQLite", median(ours), median(peer), 1.0 / 1.3)


def _record(cycle: int) -> tuple[CycleRecord, tuple[Estimate, ...]]:
    values = tuple(
        ParameterValue(f"theta_{k}", 0.1 * k + cycle, ParameterStatus.OK, "", 1e-3, 0.1, 1 / 3)
        for k in range(1, 8)
    )
    estimates = tuple(
        Estimate(
            "press_cartridge",
            name,
            cycle,
            0,
            cycle,
            values,
            EstimateStatus.ACCEPTED,
            "accepted",
            mse_test=1e-3 / cycle,
            fit_test=97.0,
        )
        for name in ESTIMATORS
    )
    return CycleRecord(cycle, 0, cycle, 850), estimates


def _store_bare(
    database: sqlite3.Connection, record: CycleRecord, estimates: tuple[Estimate, ...]
) -> None:
    text = _text(record, estimates)
    database.execute("BEGIN IMMEDIATE")
    database.execute("INSERT INTO cycle VALUES (?, ?)", (record.cycle, text))
    database.execute("COMMIT")


def _text(record: CycleRecord, estimates: tuple[Estimate, ...]) -> str:
    """Return what ours stores, as one JSON text."""
    rows = [to_row(record, 1), *(estimate_row(1, i, e) for i, e in enumerate(estimates))]
    return json.dumps(rows)


def _require_same(history: History, bare: sqlite3.Connection) -> None:
    """Refuse to compare the times of different contents."""
    kept = [text for (text,) in bare.execute("SELECT content FROM cycle ORDER BY cycle")]
    found: dict[int, list[Estimate]] = {}
    for estimate in history.estimates("/v"):
        found.setdefault(estimate.cycle, []).append(estimate)
    ours = [_text(c, tuple(found[c.cycle])) for c in history.cycles("/v")]
    if ours != kept:
        msg = "the stored cycles differ from those of sqlite3"
        raise AssertionError(msg)
