# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Fifty valves in one process: no sample is lost and the memory stays flat."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from scipy.stats import theilslopes

from test.nodes import slow_press
from test.nodes.soaking import CYCLE, PERIOD_S, Result, Soak, children, rss_mb
from valve_twin.io.history.store import History

if TYPE_CHECKING:
    from collections.abc import Mapping

VALVES = 50
BATCH = 33
FAST = 20.0
"""Times real time: 33 000 samples a second in each of three signals."""

PAUSE_S = 0.1
"""Time that the estimation of a cycle takes where it is to be too slow [s]."""

FLAT = 1.05
"""Most by least memory that is allowed of an overloaded twin after 10 min."""

GOAL_MB = 1.0
"""Growth of the memory in 10 min that is allowed [MB]."""

SAID = 12
"""Messages of diagnostics that are kept."""

BATCHED = 100
"""Samples a message at 10 kHz, of the configuration."""

CONFIG = Path(__file__).resolve().parents[2] / "config"

RESULT = Path(__file__).resolve().parents[2] / "docs" / "campaigns" / "soak.json"


@pytest.mark.timeout(900)
def test_fifty_valves_at_twenty_times_real_time_lose_nothing_and_keep_nothing(graph, tmp_path):
    """A cycle of every valve at a time: what is kept of each is seen in a second or two.

    The data of a cycle are 48 kB, its estimates some 200 blocks. What the twin remembers of the
    last 50 cycles is still being replaced by equal content, which costs about 5 kB and 50 blocks
    a cycle; that it comes to rest is for the long soak to show.
    """
    made = Soak(graph, tmp_path, valves=VALVES, rate=FAST, batch=34)
    try:
        rounds = made.rounds(10, tmp_path)
        assert made.end() == 0
    finally:
        made.end()
    assert rounds[-1].lost == 0
    assert rounds[-1].stored >= VALVES * 8
    warm = rounds[4:]
    cycles = [r.stored for r in warm]
    kept, _, surely, _ = 1e3 * np.array(theilslopes([r.rss_mb for r in warm], cycles, alpha=0.9))
    assert surely < 16.0, [r.rss_mb for r in rounds]  # it comes and goes by 3 MB
    assert kept < 36.0, [r.rss_mb for r in rounds]
    blocks = theilslopes([r.blocks for r in warm], cycles)[0]
    assert blocks < 120.0, [r.blocks for r in rounds]


@pytest.mark.timeout(900)
def test_memory_of_a_backlog_of_estimations_goes_back_to_the_system(graph, tmp_path):
    """The estimating process stands still for 70 cycles of ten valves, then catches up.

    As many cycles leave 7 to 12 MB also without a backlog: that must be much more.
    """
    made = Soak(graph, tmp_path, valves=10, rate=100.0, batch=34)
    try:
        made.rounds(3, tmp_path)
        base = rss_mb(made.twin.pid)
        (worker,) = children(made.twin.pid)
        os.kill(worker, signal.SIGSTOP)
        made.send(70)
        pending = "estimations pending"
        graph.spin_until(
            lambda: sum(int(f[pending]) for f in made.figures()) >= 690, 120.0, "a backlog"
        )
        grown = rss_mb(made.twin.pid) - base
        os.kill(worker, signal.SIGCONT)
        graph.spin_until(lambda: made.is_quiet(73 * CYCLE * 10), 240.0, "a quiet twin")
        graph.spin_until(
            lambda: rss_mb(made.twin.pid) - base < 0.6 * grown, 120.0, f"less than {grown} MB more"
        )
        assert made.end() == 0
    finally:
        made.end()


@pytest.mark.slow
@pytest.mark.timeout(7200)
def test_fifty_valves_for_half_an_hour(graph, tmp_path):
    seconds = float(os.environ.get("SOAK_S", "1800"))
    rate = float(os.environ.get("SOAK_RATE", str(FAST)))
    made = Soak(graph, tmp_path, valves=VALVES, rate=rate, batch=BATCH)
    try:
        found = made.run(seconds, 2.0, tmp_path)
        assert made.end() == 0
    finally:
        made.end()
    slopes = write(found, min(60 * CYCLE * PERIOD_S / rate, 0.5 * seconds))
    assert found.lost == 0
    assert found.pending == 0
    assert found.predicted == found.sent
    assert found.stored >= found.expected
    assert slopes["rss_mb"] < GOAL_MB
    assert slopes["worker_mb"] < GOAL_MB
    with History(made.database, read_only=True) as history:
        names = history.valves()
        assert len(names) == VALVES
        for name in names[:: VALVES // 5]:
            numbers = [c.cycle for c in history.cycles(name)]
            assert numbers == list(range(1, len(numbers) + 1))


@pytest.mark.slow
@pytest.mark.timeout(14400)
def test_half_an_hour_at_twice_what_is_estimated_stays_within_the_budget(
    graph, tmp_path, monkeypatch
):
    """Estimation takes 0.1 s a cycle and 20 cycles come a second: ten of them wait longer.

    At the end the pause is taken away, and all that waits is estimated.
    """
    seconds = float(os.environ.get("OVERLOAD_S", "1800"))
    pause = tmp_path / "pause"
    pause.write_text(str(PAUSE_S))
    slow_press.register(tmp_path, monkeypatch)
    monkeypatch.setenv(slow_press.PAUSE, str(pause))
    rate = 2.0 / PAUSE_S * CYCLE * PERIOD_S / VALVES
    made = Soak(graph, tmp_path, valves=VALVES, rate=rate, batch=BATCH, model=slow_press.NAME)
    try:
        found = made.run(seconds, 2.0, tmp_path, left_s=2.0 * seconds, over=pause.unlink)
        assert made.end() == 0
    finally:
        made.end()
    warm_s = min(600.0, 0.5 * seconds)
    write(found, warm_s, RESULT.with_name("overload.json"))
    assert found.lost == found.pending == found.dropped == 0
    assert found.predicted == found.sent
    assert found.stored >= found.expected
    assert found.most_on_disk > 0
    together = [
        (t, twin + worker)
        for (t, twin), (_, worker) in zip(found.rss_mb, found.worker_mb, strict=False)
    ]
    warm = [mb for t, mb in together if t >= warm_s]
    assert max(warm) < FLAT * min(warm)
    with History(made.database, read_only=True) as history:
        for name in history.valves():
            numbers = [c.cycle for c in history.cycles(name)]
            assert numbers == list(range(1, len(numbers) + 1))


class FastPair:
    """A valve at 10 kHz as `ros2 run` starts it: simulated in real time, with its twin."""

    NS = "/manifold/valve_1"
    CONFIG = CONFIG / "double_solenoid.yaml"

    def __init__(self, graph, folder: Path) -> None:
        self.graph, self.database = graph, folder / "fast.sqlite"
        given = ["--params-file", str(self.CONFIG)]
        url = f"sqlite:///{self.database}"
        self.twin = graph.start("twin", self.NS, given, fresh=True, history_url=url)
        self.plant = graph.start(
            "simulated_valve", self.NS, given, fresh=True, wait_for_subscribers=1
        )
        self.said = graph.record("/diagnostics", DiagnosticArray)
        self.seen: dict[str, list[tuple[float, float]]] = {"twin": [], "worker": [], "plant": []}

    def look(self, now: float) -> None:
        """Write down the memory of the three processes [MB]."""
        self.seen["twin"].append((now, rss_mb(self.twin.pid)))
        self.seen["plant"].append((now, rss_mb(self.plant.pid)))
        self.seen["worker"] += [(now, rss_mb(p)) for p in children(self.twin.pid)[:1]]
        del self.said[:-SAID]

    def figures(self) -> dict[str, str]:
        """Return the newest figures of the twin."""
        statuses = (s for m in self.said for s in m.status if s.hardware_id == self.NS)
        return {v.key: v.value for s in statuses for v in s.values}

    def is_quiet(self, received: int) -> bool:
        """Return whether all that was received is predicted and all closed cycles are stored."""
        found = self.figures()
        waiting = ("estimations pending", "cycles unsaved")
        return int(found["samples predicted"]) == received and not any(
            int(found[w]) for w in waiting
        )

    def end(self) -> dict[str, int]:
        """End the plant, let the twin finish, end it; what it told of the whole run."""
        assert self.plant.end() == 0
        keys = [k for k in self.figures() if "/lost" in k]
        self.graph.spin_until(lambda: self.is_quiet(self._received(keys)), 120.0, "a quiet twin")
        found = self.figures()
        assert self.twin.end() == 0
        with History(self.database, read_only=True) as history:
            numbers = [c.cycle for c in history.cycles(self.NS)]
            estimated = sum(1 for _ in history.estimates(self.NS))
        return {
            "messages lost": sum(int(found[k].split("/")[1]) for k in keys),
            "samples received": self._received(keys),
            "samples predicted": int(found["samples predicted"]),
            "cycles": int(found["cycle"]),
            "cycles stored": len(numbers),
            "cycle numbers left out": int(numbers != list(range(1, len(numbers) + 1))),
            "estimates": estimated,
            "waits cut off": int(found["waits cut off"]),
        }

    def _received(self, keys: list[str]) -> int:
        return BATCHED * min(int(self.figures()[k].split("/")[0]) for k in keys)


@pytest.mark.slow
@pytest.mark.timeout(7200)
def test_an_hour_of_fifty_valves_at_33_hz_and_one_at_10_khz(graph, tmp_path):
    """In real time, a message a sample, as a plant does; nothing is lost, memory stays flat."""
    seconds = float(os.environ.get("HOUR_S", "3600"))
    made = Soak(graph, tmp_path, valves=VALVES, rate=1.0, batch=1)
    fast = FastPair(graph, tmp_path)
    try:
        found = made.run(seconds, 2.0, tmp_path, look=fast.look)
        told = fast.end()
        assert made.end() == 0
    finally:
        made.end()
    warm_s = min(600.0, 0.5 * seconds)
    warm = {name: [mb for t, mb in points if t >= warm_s] for name, points in fast.seen.items()}
    warm["twin of fifty"] = [mb for t, mb in found.rss_mb if t >= warm_s]
    warm["its worker"] = [mb for t, mb in found.worker_mb if t >= warm_s]
    memory = {name: [round(f(mb), 1) for f in (min, max)] for name, mb in warm.items()}
    more = {"one at 10 kHz": told, "least, most MB after warm-up": memory}
    write(found, warm_s, RESULT.with_name("hour.json"), more)
    assert found.lost == found.pending == told["messages lost"] == 0
    assert found.predicted == found.sent
    assert found.stored >= found.expected
    assert told["samples predicted"] == told["samples received"]
    assert told["cycles"] - 1 <= told["cycles stored"] <= told["cycles"]
    assert told["cycle numbers left out"] == 0
    assert all(most < FLAT * least for least, most in memory.values()), memory


def write(
    found: Result, warm_s: float, path: Path = RESULT, more: Mapping[str, object] | None = None
) -> dict[str, float]:
    """Write the result where it is quoted; return the slopes in 10 min."""
    content = dataclasses.asdict(found) | {"warm_up_s": warm_s} | dict(more or {})
    slopes = {}
    for name in ("rss_mb", "worker_mb", "blocks"):
        points = content.pop(name)
        slope, low, high = found.slope(name, warm_s)
        slopes[name] = slope
        content[name] = {
            "slope in 10 min": round(slope, 3),
            "95 % limits": [round(low, 3), round(high, 3)],
            "least, most after warm-up": [
                round(extreme(y for x, y in points if x >= warm_s), 2) for extreme in (min, max)
            ],
            "after warm-up": round(next(y for x, y in points if x >= warm_s), 2),
            "at the end": round(points[-1][1], 2),
        }
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(content, indent=2) + "\n")
    return slopes
