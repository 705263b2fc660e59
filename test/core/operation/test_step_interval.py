# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The interval covers 95 % whether clocks are one or not, by drawn numbers."""

import numpy as np
import pytest

from valve_twin.core.operation.step_interval import interval_after


@pytest.mark.parametrize("unseen", [0.0, 0.005, 0.1, 0.5, 1.0, 2.0, 5.0, 8.0, 30.0, 2000.0])
def test_it_covers_a_normal_error_and_one_with_an_unseen_time_alike(unseen):
    rng = np.random.default_rng(3)
    error = rng.standard_normal(200_000)
    lower, upper = interval_after(1.0, unseen)
    for lacks in (error, error + unseen * rng.random(len(error))):
        assert np.mean((lacks >= lower) & (lacks <= upper)) == pytest.approx(0.95, abs=0.003)


def test_it_scales_with_its_error():
    one, ten = interval_after(1.0, 2.0), interval_after(10.0, 20.0)
    assert ten == pytest.approx(tuple(10.0 * x for x in one))
    assert interval_after(0.0, 2.0) == pytest.approx((0.0, 1.9))
