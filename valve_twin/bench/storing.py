# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The durable store of a cycle against bare SQLite."""

from __future__ import annotations

import sqlite3
import tempfile
import time
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.bench.measure import Ratio, Scale, median, require_equal
from valve_twin.core.types import Estimate, EstimateStatus, ParameterValue
from valve_twin.io.history import CycleRecord, History

if TYPE_CHECKING:
    from collections.abc import Iterator


def compare(scale: Scale) -> Iterator[Ratio]:
    """Yield the comparisons of this area."""
    yield _store(40 * scale.repeats)


def _store(cycles: int) -> Ratio:
    """Make a cycle durable: ours against bare sqlite3, its text in one table; elapsed time."""
    with tempfile.TemporaryDirectory() as folder:
        numbers, others = iter(range(1, 10**9)), iter(range(1, 10**9))
        bare = sqlite3.connect(Path(folder) / "bare.sqlite", isolation_level=None)
        with closing(bare), History(Path(folder) / "ours.sqlite") as history:
            bare.execute("PRAGMA journal_mode=WAL")
            bare.execute("PRAGMA synchronous=FULL")
            bare.execute("CREATE TABLE cycle (cycle INTEGER PRIMARY KEY, content TEXT)")
            ours = median(lambda: _store_ours(history, next(numbers)), cycles, time.perf_counter)
            peer = median(lambda: _store_bare(bare, next(others)), cycles, time.perf_counter)
            kept = bare.execute("SELECT cycle FROM cycle ORDER BY cycle").fetchall()
            stored = [[float(c.cycle)] for c in history.cycles("/v")]
            require_equal(np.array(stored), np.array(kept, dtype=float), "cycles", "sqlite3")
    return Ratio("durable store of a cycle", "bare SQLite", ours, peer, 1.0 / 1.3)


def _estimate(cycle: int) -> Estimate:
    values = tuple(ParameterValue(f"theta_{k}", 0.1 * k, standard_error=1e-3) for k in range(1, 8))
    return Estimate(
        "press_cartridge", "output_error", cycle, 0, 1, values, EstimateStatus.ACCEPTED, "accepted"
    )


def _store_ours(history: History, cycle: int) -> None:
    history.store("/v", CycleRecord(cycle, 0, 1, 850), (_estimate(cycle),))


def _store_bare(database: sqlite3.Connection, cycle: int) -> None:
    text = repr(_estimate(cycle))
    database.execute("BEGIN IMMEDIATE")
    database.execute("INSERT INTO cycle VALUES (?, ?)", (cycle, text))
    database.execute("COMMIT")
