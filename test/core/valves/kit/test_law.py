# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import numpy as np
import pytest
from numba import njit

from valve_twin.core.valves.kit import Law, parameter

NAN = float("nan")


@njit
def ramp(x, u, p, period_s):
    x[0] += p[0] * u[0] * period_s
    x[1] += 1.0


@njit
def one(x, u, p):
    x[1] = 10.0 * u[0]


LAW = Law(ramp, 2, (parameter("gain", 1.0, "1/s", "speed", lower=0.0, upper=9.0),), rest=one)


@pytest.mark.parametrize(
    ("value", "lower", "upper"),
    [(2.0, 0.0, 1.0), (NAN, 0.0, 1.0), (1.0, 1.0, 1.0), (0.0, -np.inf, 1)],
)
def test_a_parameter_outside_its_bounds_or_without_is_refused(value, lower, upper):
    with pytest.raises(ValueError, match=r"parameter 'gain' = .* must lie between its bounds"):
        parameter("gain", value, "1", "speed", lower=lower, upper=upper)


def test_a_free_run_starts_from_the_measured_output_and_the_rest_of_the_hidden_states():
    x, out = np.array([0.5, NAN]), np.full(5, NAN)
    LAW.free_run(x, np.array([2.0]), 0.1, np.arange(5.0)[:, None], 1, 2, out)
    np.testing.assert_allclose(out[2:], [0.5, 0.9, 1.5], rtol=1e-15)
    assert np.isnan(out[:2]).all()
    assert x[1] == 10.0 * 1.0 + 2.0


def test_a_law_is_compiled_into_loops_of_its_own():
    other = Law(ramp, 2, LAW.parameters)
    x, out = np.array([0.5, NAN]), np.empty(3)
    other.free_run(x, np.array([2.0]), 0.1, np.ones((3, 1)), 1, 1, out)
    assert x[1] == 1.0  # its hidden state rests at 0
    assert other.free_run is not LAW.free_run
