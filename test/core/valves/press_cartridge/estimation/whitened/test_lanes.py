# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Eight filters at once: what the scalar one says, and its derivative by the pole."""

import numpy as np
import pytest

from valve_twin.core.valves.press_cartridge.estimation.kalman_kernel import whiten
from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import (
    N_COLUMNS,
    N_LINEAR,
    Stretch,
    pack_rows,
    sample_flags,
)
from valve_twin.core.valves.press_cartridge.estimation.solvers.lanes import LANES
from valve_twin.core.valves.press_cartridge.estimation.whitened.lanes import (
    AT,
    BY_POLE,
    BY_POLE_TOTAL,
    GRAM,
    LOG_TOTAL,
    POLE,
    RATIO,
    SIZE,
    whiten_lanes,
)

V_MAX = 0.8
P = np.array([0.01, 0.004, 0.03, 0.01, 1e-4])
POLES = np.linspace(0.0, 0.9, LANES)
RATIOS = np.exp(np.linspace(-12.0, 9.0, LANES))
LOWER = np.tril_indices(N_COLUMNS)


def stretch(n: int = 160, seed: int = 3) -> Stretch:
    """Return a cycle with rests on a seat, a break, levels that are less known, lost samples."""
    rng = np.random.default_rng(seed)
    free = np.ones(n, bool)
    free[:20] = free[70:95] = False
    anchor = np.zeros(n)
    anchor[[70, 120]] = np.inf
    anchor[[22, 97]] = 9.0
    moving = free & (np.arange(n) % 40 < 25)
    v_in = np.where(moving, rng.uniform(0.1, V_MAX, n), 0.0)
    v_out = np.where(rng.random(n) > 0.7, 0.3, 0.0)
    use = rng.random(n) > 0.2
    use[75:90] = False
    return Stretch(
        0.2 + np.cumsum(rng.normal(0.0, 1e-3, n)), use, free, anchor, moving, v_in, v_out
    )


def lanes(data, poles=POLES):
    work = np.zeros(SIZE)
    work[POLE : POLE + LANES] = poles
    work[RATIO : RATIO + LANES] = RATIOS
    work[AT : AT + LANES * N_LINEAR] = np.repeat(P, LANES)
    rows = pack_rows(data)
    return whiten_lanes(*rows, V_MAX, work), work


def scalar(data, pole, ratio):
    """Return normal equations, log determinant and rows, and the cost at `P`."""
    gram = np.zeros((N_COLUMNS, N_COLUMNS))
    total, rows = whiten(data, pole, V_MAX, ratio, P, gram)
    left = np.array([*-P, 0.0, 1.0])
    return gram, total, rows, left @ gram @ left


@pytest.mark.parametrize("lane", range(LANES))
def test_each_lane_is_the_scalar_filter(lane):
    data = stretch()
    rows, work = lanes(data)
    gram, total, expected_rows, _ = scalar(data, POLES[lane], RATIOS[lane])
    found = work[GRAM : GRAM + LANES * len(LOWER[0])].reshape(-1, LANES)[:, lane]
    size = np.sqrt(np.diag(gram))
    assert rows == expected_rows
    assert work[LOG_TOTAL + lane] == pytest.approx(total, abs=1e-10)
    assert found / np.outer(size, size)[LOWER] == pytest.approx(
        (gram / np.outer(size, size))[LOWER], abs=1e-8
    )


@pytest.mark.parametrize("lane", range(1, LANES))
def test_the_derivative_by_the_pole_is_that_of_differences(lane):
    data, step = stretch(), 1e-5
    _, work = lanes(data)
    above, below = (scalar(data, POLES[lane] + h, RATIOS[lane]) for h in (step, -step))
    cost, total = ((a - b) / (2.0 * step) for a, b in ((above[3], below[3]), (above[1], below[1])))
    assert work[BY_POLE + lane] == pytest.approx(cost, rel=1e-5, abs=1e-9)
    assert work[BY_POLE_TOTAL + lane] == pytest.approx(total, rel=1e-5)


def test_a_lane_does_not_depend_on_the_others():
    data = stretch()
    _, apart = lanes(data)
    _, changed = lanes(data, np.where(np.arange(LANES) == 3, POLES, 0.5))
    sums = np.arange(LOG_TOTAL, POLE)
    third = sums[sums % LANES == 3]
    assert apart[third].tobytes() == changed[third].tobytes()


def test_rest_without_weight_is_left_out():
    data = stretch()
    assert len(pack_rows(data).y) < len(data.y)
    assert sample_flags(data).tolist() == (1 * data.free + 2 * data.use + 4 * data.moving).tolist()
