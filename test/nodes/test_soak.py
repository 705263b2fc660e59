# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Fifty valves in one process: no sample is lost and the memory stays flat."""

from __future__ import annotations

import dataclasses
import json
import os
from pathlib import Path

import pytest

from test.nodes.soaking import CYCLE, PERIOD_S, Soak
from valve_twin.io.history import History

VALVES = 50
BATCH = 33
FAST = 20.0
"""Times real time: 33 000 samples a second in each of three signals."""

GOAL_MB = 1.0
"""Growth of the memory in 10 min that is allowed [MB]."""

RESULT = Path(__file__).resolve().parents[2] / "docs" / "campaigns" / "soak.json"


def soak(graph, folder: Path, rate: float, seconds: float, every_s: float):
    made = Soak(graph, folder, valves=VALVES, rate=rate, batch=BATCH)
    try:
        found = made.run(seconds, every_s, folder)
        assert made.end() == 0
    finally:
        made.end()
    assert found.lost == 0
    assert found.pending == 0
    assert found.predicted == found.sent
    assert found.stored >= found.expected
    with History(made.database, read_only=True) as history:
        names = history.valves()
        assert len(names) == VALVES
        for name in names[:: VALVES // 5]:
            numbers = [c.cycle for c in history.cycles(name)]
            assert numbers == list(range(1, len(numbers) + 1))
    return found


def test_fifty_valves_at_twenty_times_real_time_lose_nothing_and_keep_no_cycle(graph, tmp_path):
    """Half a minute is too short to tell 1 MB in 10 min: the memory of the last 50 cycles is still
    being replaced. It tells whether cycles (48 kB each) or samples are kept."""
    found = soak(graph, tmp_path, FAST, 22.0, 0.25)
    warm_s = 5 * CYCLE * PERIOD_S / FAST
    cycles = VALVES * 600.0 * FAST / (CYCLE * PERIOD_S)
    slope, low, _ = found.slope("rss_mb", warm_s)
    assert 1e3 * low / cycles < 12.0, f"{1e3 * slope / cycles:.1f} kB a cycle are kept"
    blocks, least, _ = found.slope("blocks", warm_s)
    assert least / cycles < 100.0, f"{blocks / cycles:.1f} blocks a cycle are kept"


@pytest.mark.slow
def test_fifty_valves_for_half_an_hour(graph, tmp_path):
    seconds = float(os.environ.get("SOAK_S", "1800"))
    rate = float(os.environ.get("SOAK_RATE", str(FAST)))
    found = soak(graph, tmp_path, rate, seconds, 2.0)
    warm_s = min(60 * CYCLE * PERIOD_S / rate, 0.5 * seconds)
    slopes = {name: found.slope(name, warm_s) for name in ("rss_mb", "worker_mb", "blocks")}
    content = dataclasses.asdict(found)
    for name, (slope, low, high) in slopes.items():
        points = content.pop(name)
        content[name] = {
            "slope in 10 min": round(slope, 3),
            "95 % limits": [round(low, 3), round(high, 3)],
            "after warm-up": round(next(y for x, y in points if x >= warm_s), 2),
            "at the end": round(points[-1][1], 2),
        }
    content["warm_up_s"] = warm_s
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(json.dumps(content, indent=2) + "\n")
    assert slopes["rss_mb"][0] < GOAL_MB
    assert slopes["worker_mb"][0] < GOAL_MB
