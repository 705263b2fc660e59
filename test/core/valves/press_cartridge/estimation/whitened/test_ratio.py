# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The search of noise ratio and pole: not worse than the one that goes through everything."""

import numpy as np
import pytest

from test.core.valves.press_cartridge.generator import Truth, generate_cycle
from valve_twin.core.estimation.data.masks import find_masks
from valve_twin.core.valves.press_cartridge.estimation.free_run import (
    OutputErrorOptions,
    find_phases,
    lay_out,
)
from valve_twin.core.valves.press_cartridge.estimation.kalman_kernel import (
    restricted,
    search_ratio,
)
from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import (
    N_COLUMNS,
    N_LINEAR,
)
from valve_twin.core.valves.press_cartridge.estimation.whitened.ratio import (
    find_in_lanes,
    find_ratio,
    look_around,
    moments_around,
)

OPTIONS = OutputErrorOptions()
V_MAX = OPTIONS.v_max
ALL = np.ones(N_LINEAR, bool)
PRIORS = {"alone": np.zeros(2), "with others": np.array([-1.0, 6.0])}


def data_of(sigma, seed):
    truth = Truth(sigma=sigma)
    frames = generate_cycle(truth, np.random.default_rng([61, seed])).frames
    run = lay_out(frames, find_masks(frames, 0.03, push=(1.0, -1.0)), 0.03, sigma, OPTIONS)
    return find_phases(run, 2.0, OPTIONS, settle=0).stretch(run.position, run.use)


def arrays():
    return np.zeros(N_LINEAR), np.zeros((N_COLUMNS, N_COLUMNS))


def slow_value(data, prior, ratio, pole):
    """Return minus twice the log restricted likelihood of a ratio, its pole searched near one."""
    at = max(ratio, np.exp(-14.0))
    return restricted(data, V_MAX, at, ALL, prior, 0.0, 0.98, pole, *arrays())[0]


@pytest.mark.parametrize("prior", PRIORS.values(), ids=PRIORS)
@pytest.mark.parametrize("sigma", [1e-5, 1e-3])
def test_nothing_better_is_found_by_going_through_everything(sigma, prior):
    decided = 0
    for seed in range(6):
        data = data_of(sigma, seed)
        found = find_in_lanes(data, V_MAX, ALL, prior, -1.0, *arrays())
        slow = search_ratio(data, V_MAX, ALL, prior, -1.0, -1.0, *arrays())
        if found[4] < 0:
            continue
        decided += 1
        ours, theirs = (slow_value(data, prior, r[1], r[2]) for r in (found, slow))
        assert found[4] == slow[4]
        assert ours <= theirs + 5e-3  # its pole is known within 1e-3 only
    assert decided >= 3


def test_what_lanes_leave_is_searched_slowly():
    """Of exact data every ratio is as good; the slow search says what it always said."""
    data = data_of(1e-3, 0)
    still = data._replace(y=np.full(len(data.y), 0.5))
    found = find_ratio(still, V_MAX, ALL, np.zeros(2), -1.0, -1.0, *arrays())
    assert found[4] == find_ratio(data, V_MAX, ALL, np.zeros(2), -1.0, 0.1, *arrays())[4]
    assert found[:5] == search_ratio(still, V_MAX, ALL, np.zeros(2), -1.0, -1.0, *arrays())[:5]


def test_a_given_pole_stays():
    data = data_of(1e-5, 1)
    found = find_in_lanes(data, V_MAX, ALL, np.zeros(2), 0.4, *arrays())
    slow = search_ratio(data, V_MAX, ALL, np.zeros(2), 0.4, -1.0, *arrays())
    assert found[2] == 0.4
    assert np.log(found[0]) == pytest.approx(np.log(slow[0]), abs=0.02)


def test_data_without_noise_are_left_to_the_slow_search():
    data = data_of(1e-3, 0)
    still = data._replace(y=np.full(len(data.y), 0.5))
    assert find_in_lanes(still, V_MAX, ALL, np.zeros(2), -1.0, *arrays())[4] < 0


def test_moments_about_the_ratio_are_those_of_its_neighbours():
    data, prior = data_of(1e-5, 1), np.zeros(2)
    p, gram = arrays()
    _, ratio, pole, _, rows, value = find_in_lanes(data, V_MAX, ALL, prior, -1.0, p, gram)
    assert rows > 0
    assert value == pytest.approx(slow_value(data, prior, ratio, pole), abs=5e-3)
    log_ratio = np.log(ratio) + np.linspace(0.5, 2.0, 8)
    around = look_around(data, V_MAX, ALL, prior, log_ratio, (0.0, 0.98), pole, p)
    expected = [slow_value(data, prior, np.exp(at), pole) for at in log_ratio]
    assert around[0].value == pytest.approx(expected, abs=5e-3)
    variance, moments, regular = moments_around(around, np.arange(6), pole, p, True)
    assert regular
    assert variance == pytest.approx(np.full(8, variance.mean()), rel=1.0)
    assert (np.diagonal(moments, axis1=1, axis2=2) > 0.0).all()
