# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Speed against what a user would write otherwise: same input, same output, one run, CPU time.

Every line is a ratio of medians; absolute figures stand beside the time of a reference loop (a
plain Python sum over a million numbers) of the same run. Results are asserted equal before a ratio
is printed.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.constraints import physical_inequalities
from valve_twin.core.estimation.masks import find_masks
from valve_twin.core.estimation.qp import solve_qp, solve_qp_cvxpy
from valve_twin.core.estimation.regression import design, gram, usable_rows
from valve_twin.core.simulation import SimulatedValve, simulate_cycles, to_frames
from valve_twin.core.valves.registry import get_simulation
from valve_twin.io.bags import BagWriter, read_signals
from valve_twin.io.mapping import SignalSource

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.types import FloatArray


@dataclass(frozen=True, slots=True)
class Ratio:
    """One comparison: how many times less CPU time ours takes, and the goal it is held to."""

    name: str
    peer: str
    ours_s: float
    peer_s: float
    goal: float

    @property
    def value(self) -> float:
        """Peer over ours [1]."""
        return self.peer_s / self.ours_s

    @property
    def passed(self) -> bool:
        """Whether it reaches half its goal: machines are noisy."""
        return self.value >= 0.5 * self.goal


def run_benchmarks(*, quick: bool, write: Callable[[str], object]) -> bool:
    """Run all comparisons and print one line each.

    Parameters
    ----------
    quick : bool
        Smaller inputs and fewer repetitions: seconds instead of minutes.
    write : callable
        Takes the text.

    Returns
    -------
    bool
        Whether every ratio reaches half its goal.
    """
    repeats = 5 if quick else 15
    loop = _median(lambda: sum(range(1_000_000)), repeats)
    write(f"reference loop (Python sum over 1e6 numbers): {loop * 1e3:.1f} ms\n")
    ratios = [
        _simulation(repeats),
        _constrained_solve(repeats),
        _bag_reading(100_000 if quick else 1_000_000, repeats),
    ]
    for r in ratios:
        mark = "ok" if r.passed else "BELOW HALF ITS GOAL"
        write(
            f"{r.name}: {r.value:.0f} x {r.peer} (goal {r.goal:g} x; "
            f"{r.ours_s * 1e3:.3g} ms against {r.peer_s * 1e3:.4g} ms) {mark}\n"
        )
    return all(r.passed for r in ratios)


def _median(action: Callable[[], object], repeats: int) -> float:
    """Return the median CPU time of an action after one warm-up [s]."""
    action()
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        action()
        times.append(time.process_time() - begin)
    return max(statistics.median(times), 1e-9)


def _simulation(repeats: int) -> Ratio:
    """Compare the CPU time of a production cycle of the press valve with its length."""
    config = get_simulation("press_cartridge")
    valve = SimulatedValve(config, seed=1)
    ours = _median(lambda: valve.advance(config.cycle_samples), repeats)
    return Ratio("simulated press valve", "real time", ours, config.program.duration_s, 100.0)


def _constrained_solve(repeats: int) -> Ratio:
    """Paper 002, (22) with all eight terms: our exact solver against cvxpy, rebuilt each cycle."""
    config = get_simulation("press_cartridge")
    (block,) = simulate_cycles(config, 1, seed=1)
    frames = to_frames(block)
    masks = find_masks(frames, config.period_s, push=(1.0, -1.0))
    rows = usable_rows(frames, masks, 2)
    inequalities = physical_inequalities(v_in_max=0.8, v_out_max=0.8)
    u, y = design(frames, rows, 2)
    equations = gram(frames, rows, 2)
    ours, peer = solve_qp(equations, inequalities), solve_qp_cvxpy(u, y, inequalities)
    _same_cost(ours.cost, peer.cost)
    return Ratio(
        "constrained solve of one cycle",
        "cvxpy",
        _median(lambda: solve_qp(equations, inequalities), 10 * repeats),
        _median(lambda: solve_qp_cvxpy(u, y, inequalities), repeats),
        20.0,
    )


def _same_cost(ours: float, peer: float) -> None:
    if not ours <= peer * (1.0 + 1e-6):
        msg = f"the costs differ: ours {ours!r}, cvxpy {peer!r}"
        raise AssertionError(msg)


def _bag_reading(messages: int, repeats: int) -> Ratio:
    """Read a bag of stamped scalars into columns: ours against rosbags' AnyReader."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bag"
        values = np.random.default_rng(1).normal(size=messages)
        with BagWriter(path) as bag:
            for n, value in enumerate(values.tolist()):
                bag.write_sample("/position", 10**18 + n * 30_000_000, value)
        if not np.array_equal(_read_ours(path), _read_rosbags(path)):
            msg = "the values differ from those of rosbags"
            raise AssertionError(msg)
        return Ratio(
            f"reading {messages} messages into columns",
            "rosbags",
            _median(lambda: _read_ours(path), repeats),
            _median(lambda: _read_rosbags(path), max(1, repeats // 5)),
            20.0,
        )


def _read_ours(path: Path) -> FloatArray:
    blocks = read_signals(path, [SignalSource("position", "/position")])
    return np.concatenate([b.values for b in blocks])


def _read_rosbags(path: Path) -> FloatArray:
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as reader:
        found = [
            reader.deserialize(raw, connection.msgtype).value  # type: ignore[attr-defined]
            for connection, _, raw in reader.messages()
        ]
    return np.array(found)
