# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The generic model: what it chooses on records whose making is known, and how it predicts."""

import json
import re
import subprocess
import sys

import numpy as np
import pytest
from scipy.signal import lfilter

from valve_twin.cli import main
from valve_twin.core.estimation.cycle.memory import Memory, model_in_force
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.prediction import fit_percent, restart_marks, run_model
from valve_twin.core.types import Cycle, EstimateStatus, Frames
from valve_twin.core.valves.hammerstein_wiener.fit import BLOCKS, Data, choose
from valve_twin.core.valves.hammerstein_wiener.model import MODEL
from valve_twin.core.valves.registry import complete_options

N = 800
OPTIONS = complete_options(MODEL, {})


def commands(seed, hold=20, n=N):
    levels = np.random.default_rng(seed).uniform(0.0, 1.0, n // hold)
    return np.repeat(levels, hold)


def linear(u, lag=3):
    """Second order, poles 0.9 and 0.5, gain 2."""
    late = np.concatenate([np.full(lag, u[0]), u[:-lag]])
    start = 2.0 * u[0]
    return start + lfilter([0.1], [1.0, -1.4, 0.45], late - u[0])


def dead_zone(u):
    return np.clip(u - 0.4, 0.0, 0.35)


def frames(u, y, first=0):
    nothing = np.full(len(y), np.nan)
    stamps = (first + np.arange(len(y))) * 10**8
    return Frames(stamps, y, u[:, None], nothing, nothing, np.ones(len(y), dtype=np.bool_))


def noisy(y, seed=0, sigma=0.005):
    return y + np.random.default_rng(seed).normal(0.0, sigma, len(y))


def chosen(u, y, blocks=BLOCKS):
    data = Data(u, y, np.ones(len(y), dtype=np.bool_))
    return choose(data, blocks=blocks, max_order=3, max_lag=8)


def test_a_linear_valve_gets_its_order_its_lag_and_no_curve():
    u = commands(1)
    fit = chosen(u, noisy(linear(u)))
    assert fit.shape.order == 2
    assert fit.shape.lag in (2, 3)  # one sample less where its first coefficient is 0
    assert [fit.shape.rates, fit.shape.curved, fit.shape.bent] == [False] * 3
    assert fit.coefficients[2:4] == pytest.approx([-1.4, 0.45], abs=0.02)
    assert fit.rmse == pytest.approx(0.005, rel=0.1)


@pytest.mark.no_cover
def test_a_dead_zone_with_saturation_gets_a_curve_of_the_command():
    u = commands(2)
    fit = chosen(u, noisy(linear(dead_zone(u)), sigma=0.002))
    plain = chosen(u, noisy(linear(dead_zone(u)), sigma=0.002), blocks=())
    assert fit.shape.curved
    assert fit.left_out < 0.4 * plain.left_out


def test_blocks_that_are_not_allowed_are_not_there():
    u = commands(2)
    shape = chosen(u, noisy(linear(dead_zone(u))), blocks=("rates",)).shape
    assert [shape.curved, shape.bent] == [False, False]


def test_rates_of_each_direction_are_found():
    u, y = commands(3), np.zeros(N)
    y[0] = u[0]
    for n in range(1, N):
        away = u[n - 1] - y[n - 1]
        y[n] = y[n - 1] + np.clip(0.5 * away, -0.03, 0.2)
    estimate, _ = estimate_cycle(
        MODEL, OPTIONS, Cycle(1, 0.1, frames(u, noisy(y, sigma=0.002))), Memory.empty()
    )
    (found,) = estimate
    assert found.value("limit_down") == pytest.approx(0.03, rel=0.02)
    assert found.value("rate_up") == pytest.approx(0.5, rel=0.05)
    assert found.value("static_gain") == pytest.approx(1.0, abs=0.01)
    assert found.value("response_falling") > 3.0 * found.value("response_rising")


@pytest.mark.no_cover
def test_the_blocks_of_the_second_cycle_are_kept_and_follow_what_is_unseen():
    memory, shown = Memory.empty(), []
    for k in range(3):
        u = commands(10 + k)
        cycle = Cycle(k + 1, 0.1, frames(u, noisy(linear(dead_zone(u)), k), k * N))
        (estimate,), memory = estimate_cycle(MODEL, OPTIONS, cycle, memory)
        assert estimate.status is EstimateStatus.ACCEPTED
        shown.append([p.name for p in estimate.parameters])
        if k:
            assert estimate.fit_test > 92.0  # 7 knots round off the corners
    assert shown[2] == shown[1]


def test_the_free_run_is_not_moved_by_a_sensor_that_drifts():
    u = commands(4)
    y = noisy(linear(u))
    _, memory = estimate_cycle(MODEL, OPTIONS, Cycle(1, 0.1, frames(u, y)), Memory.empty())
    force = model_in_force(MODEL, memory, 0.1, OPTIONS)
    assert force is not None
    u, drift = commands(5), np.cumsum(np.random.default_rng(0).normal(0.0, 0.01, N))
    unseen = frames(u, noisy(linear(u)) + drift, N)
    marks = restart_marks(unseen, 0.1)
    run = run_model(MODEL, MODEL.initial_state(), force.coefficients, unseen, marks)
    known = np.isfinite(run.simulated)
    assert fit_percent(linear(u)[known], run.simulated[known]) > 95.0


@pytest.mark.parametrize(
    ("u", "y", "told"),
    [
        (np.ones(N), noisy(commands(1)), "the command stayed at 1"),
        (commands(1), np.ones(N), "the answer stayed at 1"),
        (commands(1)[:60], commands(2)[:60], "60 usable samples without a gap, fewer than 100"),
    ],
)
def test_a_cycle_that_shows_nothing_is_refused(u, y, told):
    ((estimate,), _) = estimate_cycle(MODEL, OPTIONS, Cycle(1, 0.1, frames(u, y)), Memory.empty())
    assert estimate.status is EstimateStatus.REFUSED
    assert told in estimate.reason


@pytest.mark.no_cover
def test_its_aging_is_found_and_reported_from_a_simulated_bag(root, tmp_path, capsys):
    bag, page = tmp_path / "bag", tmp_path / "page.html"
    config = ["--config", str(root / "config" / "hammerstein_wiener.yaml")]
    assert main(["simulate", *config, "--cycles", "20", "--out", str(bag)]) == 0
    capsys.readouterr()
    assert main(["estimate", str(bag), *config]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    trends = {line["parameter"]: line for line in lines if "slope" in line}
    rising = trends["response_rising"]
    assert rising["slope_lower_95"] < 0.005 * 0.4 < rising["slope_upper_95"]
    assert trends["static_gain"]["status"] == "STEADY"
    assert main(["report", str(bag), *config, "--out", str(page)]) == 0
    assert re.search("response_rising", page.read_text(encoding="utf-8"))


@pytest.mark.no_cover
def test_a_live_twin_does_not_load_what_only_the_choice_of_blocks_uses():
    """`scipy.signal` with all that it loads takes 60 MB."""
    code = (
        "import sys, valve_twin.report.build\n"
        "from valve_twin.core.valves.hammerstein_wiener.model import MODEL\n"
        "sys.exit('scipy.signal' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
