# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Speed against what a user would write otherwise: same input, same output, one run, CPU time.

Every line is a ratio of medians; absolute figures stand beside the time of a reference loop (a
plain Python sum over a million numbers) of the same run. Results are asserted equal before a ratio
is printed.
"""

from __future__ import annotations

import sqlite3
import statistics
import tempfile
import time
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.constraints import physical_inequalities
from valve_twin.core.estimation.masks import find_masks
from valve_twin.core.estimation.qp import solve_qp, solve_qp_cvxpy
from valve_twin.core.estimation.regression import design, gram, usable_rows
from valve_twin.core.simulation import SimulatedValve, simulate_cycles, to_frames
from valve_twin.core.types import Estimate, EstimateStatus, ParameterValue
from valve_twin.core.valves.press_cartridge.predictor import predict_block
from valve_twin.core.valves.registry import complete_options, get_model, get_simulation
from valve_twin.io.bags import BagWriter, read_signals
from valve_twin.io.history import CycleRecord, History
from valve_twin.io.mapping import SignalSource

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from valve_twin.core.types import FloatArray, Frames


@dataclass(frozen=True, slots=True)
class Ratio:
    """One comparison: how many times less time ours takes, and the goal it is held to.

    A goal below 1 allows an overhead over a peer that does less.
    """

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
    passed = True
    for ratio in _comparisons(repeats, 100_000 if quick else 1_000_000):
        write(f"{describe(ratio)}\n")
        passed = passed and ratio.passed
    return passed


def _comparisons(repeats: int, messages: int) -> Iterator[Ratio]:
    yield _simulation(repeats)
    yield _prediction(repeats)
    yield _constrained_solve(repeats)
    yield _bag_reading(messages, repeats)
    yield _store(40 * repeats)


def describe(ratio: Ratio) -> str:
    """Return a comparison as one line."""
    mark = "ok" if ratio.passed else "BELOW HALF ITS GOAL"
    return (
        f"{ratio.name}: {ratio.value:.3g} x {ratio.peer} (goal {ratio.goal:.3g} x; "
        f"{ratio.ours_s * 1e3:.3g} ms against {ratio.peer_s * 1e3:.4g} ms) {mark}"
    )


def _median(
    action: Callable[[], object], repeats: int, clock: Callable[[], float] = time.process_time
) -> float:
    """Return the median time of an action after a warm-up [s], CPU time unless told otherwise."""
    action()
    times = []
    for _ in range(repeats):
        begin = clock()
        action()
        times.append(clock() - begin)
    return max(statistics.median(times), 1e-9)


def _simulation(repeats: int) -> Ratio:
    """Compare the CPU time of a production cycle of the press valve with its length."""
    config = get_simulation("press_cartridge")
    valve = SimulatedValve(config, seed=1)
    ours = _median(lambda: valve.advance(config.cycle_samples), repeats)
    return Ratio("simulated press valve", "real time", ours, config.program.duration_s, 100.0)


def _prediction(repeats: int) -> Ratio:
    """One-step prediction and free run of 200 samples: compiled against the same Python loop."""
    config = get_simulation("press_cartridge")
    (block,) = simulate_cycles(config, 1, seed=1)
    frames = to_frames(block)[:200]
    model = get_model("press_cartridge")
    values = {"pole": 0.6, "K_in": 0.0098, "K_out": 0.045, "leak": 1e-3}
    options = complete_options(model, {})
    coefficients = model.coefficients(values, 2, config.period_s, options)
    loop: Callable[..., None] = predict_block.py_func  # type: ignore[attr-defined]
    ours = _predicted(predict_block, frames, coefficients, model.initial_state())
    peer = _predicted(loop, frames, coefficients, model.initial_state())
    _require_equal(ours, peer, "predictions", "the Python loop")
    return Ratio(
        "prediction of 200 samples",
        "a Python loop",
        _median(
            lambda: _predicted(predict_block, frames, coefficients, model.initial_state()),
            20 * repeats,
        ),
        _median(lambda: _predicted(loop, frames, coefficients, model.initial_state()), repeats),
        50.0,
    )


def _predicted(
    kernel: Callable[..., None], frames: Frames, coefficients: FloatArray, state: FloatArray
) -> FloatArray:
    out = np.empty((2, len(frames)))
    codes = np.zeros((2, len(frames)), dtype=np.uint8)
    inputs = np.ascontiguousarray(frames.inputs)
    kernel(state, coefficients, frames.position, inputs, codes[0], out[0], out[1], codes[1])
    return out


def _require_equal(ours: FloatArray, peer: FloatArray, what: str, whom: str) -> None:
    if not np.array_equal(ours, peer, equal_nan=True):
        msg = f"the {what} differ from those of {whom}"
        raise AssertionError(msg)


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
        _require_equal(_read_ours(path), _read_rosbags(path), "values", "rosbags")
        return Ratio(
            f"reading {messages} messages into columns",
            "rosbags",
            _median(lambda: _read_ours(path), repeats),
            _median(lambda: _read_rosbags(path), max(3, repeats // 5)),
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


def _store(cycles: int) -> Ratio:
    """Make a cycle durable: ours against bare sqlite3, its text in one table; elapsed time."""
    with tempfile.TemporaryDirectory() as folder:
        numbers, others = iter(range(1, 10**9)), iter(range(1, 10**9))
        bare = sqlite3.connect(Path(folder) / "bare.sqlite", isolation_level=None)
        with closing(bare), History(Path(folder) / "ours.sqlite") as history:
            bare.execute("PRAGMA journal_mode=WAL")
            bare.execute("PRAGMA synchronous=FULL")
            bare.execute("CREATE TABLE cycle (cycle INTEGER PRIMARY KEY, content TEXT)")
            ours = _median(lambda: _store_ours(history, next(numbers)), cycles, time.perf_counter)
            peer = _median(lambda: _store_bare(bare, next(others)), cycles, time.perf_counter)
            kept = bare.execute("SELECT cycle FROM cycle ORDER BY cycle").fetchall()
            stored = [[float(c.cycle)] for c in history.cycles("/v")]
            _require_equal(np.array(stored), np.array(kept, dtype=float), "cycles", "sqlite3")
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
