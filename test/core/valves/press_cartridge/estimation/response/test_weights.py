# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Weights of a cycle's samples, computed once, and rests taken as one step."""

import numpy as np
import pytest

from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import (
    Rows,
    Stretch,
    accumulate,
)
from valve_twin.core.valves.press_cartridge.estimation.response.lanes import (
    AT,
    DELAY,
    POLE,
    SIZE,
    STILL,
    read_lane,
    run_lanes,
)
from valve_twin.core.valves.press_cartridge.estimation.response.weights import (
    HOLD,
    MOTION,
    REST,
    weigh_rows,
)

V_MAX, WANDER = 0.8, 0.03
POLES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.95, 0.2)
P = np.array([0.03, 0.01, 0.05, 0.02, 1e-4])


def a_cycle(seed, used):
    """Long holds, seats and a hold while stuck, levels less known or lost, samples without use."""
    rng = np.random.default_rng(seed)
    size = 1500
    v_in, v_out = np.zeros(size), np.zeros(size)
    v_in[30:60], v_out[700:730], v_in[1000:1010] = 0.4, 0.6, 0.2
    free = np.ones(size, np.bool_)
    free[:20], free[760:900], free[1200:1300] = False, False, False
    moving = np.zeros(size, np.bool_)
    moving[25:75], moving[695:745], moving[995:1020] = True, True, True
    anchor = np.zeros(size)
    anchor[rng.integers(0, size, 20)] = 5.0
    anchor[[0, 300, 760, 850]] = np.inf
    use = rng.random(size) < used
    y = 0.3 + 1e-3 * np.cumsum(rng.normal(size=size))
    return Stretch(y, use, free, anchor, moving, v_in, v_out)


def rows_of(data):
    flags = (1 * data.free + 2 * data.use + 4 * data.moving).astype(np.uint8)
    return Rows(data.y, flags, data.anchor, data.v_in, data.v_out)


@pytest.mark.parametrize("used", [1.0, 0.5])
@pytest.mark.parametrize("seed", range(4))
def test_eight_runs_with_rests_as_one_step_are_those_of_every_sample(seed, used):
    data = a_cycle(seed, used)
    weighed, work = weigh_rows(rows_of(data), WANDER, 0.0), np.zeros(SIZE)
    work[POLE : POLE + 8], work[DELAY : DELAY + 8] = POLES, 0.0
    for k, value in enumerate(P):
        work[AT + 8 * k : AT + 8 * k + 8] = value
    run_lanes(weighed, V_MAX, STILL, work)
    for lane, pole in enumerate(POLES):
        expected, found = np.zeros((7, 7)), np.zeros((7, 7))
        log_determinant, rows = accumulate(data, pole, V_MAX, WANDER, P, expected)
        read_lane(work, lane, found)
        size = np.sqrt(np.diag(expected))
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-11 * size.max() ** 2)
        assert weighed.rows == rows
        assert weighed.log_determinant == pytest.approx(log_determinant, rel=1e-12)


def test_the_longest_delay_counts_as_motion():
    data = a_cycle(0, 1.0)
    kinds = [weigh_rows(rows_of(data), WANDER, latest).kind for latest in (0.0, 2.5)]
    assert kinds[0][59:63].tolist() == [MOTION, MOTION, HOLD, HOLD]
    assert kinds[1][59:64].tolist() == [MOTION, MOTION, MOTION, MOTION, HOLD]
    assert set(kinds[0][760:900]) == {REST}
