# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Errors of a model over a cycle have the bits of numpy's."""

import numpy as np
import pytest

from valve_twin.core.estimation.cycle.errors import model_errors
from valve_twin.core.prediction import fit_percent
from valve_twin.core.types import Validity


@pytest.mark.parametrize("size", [3, 9, 130, 1201])
@pytest.mark.parametrize("seed", range(3))
def test_errors_are_those_of_numpy(size, seed):
    rng = np.random.default_rng([seed, size])
    y, predicted, simulated = rng.normal(size=(3, size))
    simulated = y + 0.1 * simulated
    y[rng.random(size) < 0.05] = np.nan
    predicted[rng.random(size) < 0.05] = np.nan
    simulated[rng.random(size) < 0.05] = np.nan
    valid = rng.random(size) < 0.9
    validity = np.where(np.isfinite(y), rng.integers(0, 3, size), Validity.BAD_INPUT)
    validity = validity.astype(np.uint8)
    good = (validity == Validity.VALID) & np.isfinite(predicted)
    least = 3
    mse = np.mean((y[good] - predicted[good]) ** 2) if good.sum() >= least else np.nan
    fit = fit_percent(y[valid], simulated[valid], least=least)
    found = model_errors(y, valid, predicted, simulated, validity, least)
    np.testing.assert_array_equal(found, (mse, fit))


def test_a_position_that_never_changes_has_no_fit():
    still, one = np.full(5, 0.3), np.ones(5, np.bool_)
    found = model_errors(still, one, still + 0.1, still, np.zeros(5, np.uint8), 3)
    assert found[0] == np.mean((still - (still + 0.1)) ** 2)
    assert np.isnan(found[1])
    assert np.isnan(model_errors(still, ~one, still, still, np.full(5, 4, np.uint8), 3)).all()
