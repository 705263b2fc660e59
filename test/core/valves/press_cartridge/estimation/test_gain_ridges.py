# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a clear fit says of its parameters by the short way, against the general one."""

from __future__ import annotations

import numpy as np
import pytest

from valve_twin.core.estimation.solvers.least_squares import gram_condition
from valve_twin.core.valves.press_cartridge.estimation import gain_ridges
from valve_twin.core.valves.press_cartridge.estimation.free_run import OutputErrorOptions, Solution
from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import N_COLUMNS

PERIOD_S = 0.03
OPTIONS = OutputErrorOptions()


def solution(seed, *, on_bound=(), spread=1.0):
    """Return a fit whose sensitivities are random; `spread` = 0 makes the first two alike."""
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(200, N_COLUMNS)) * 10.0 ** rng.uniform(-2.0, 2.0, N_COLUMNS)
    columns[:, 1] = columns[:, 0] + spread * columns[:, 1]
    linear = rng.uniform(0.005, 0.02, 5)
    linear[list(on_bound)] = 0.0
    gram = columns.T @ columns
    return Solution(0.3, linear, gram, np.ones(5, bool), 1e-8, 200, 0.0, 0.4)


def fitted(s):
    return np.flatnonzero(np.append(s.linear > 0.0, True))


@pytest.mark.parametrize("on_bound", [(), (0,), (1,), (2,), (3,), (4,), (0, 3), (1, 3, 4), (0, 1)])
@pytest.mark.parametrize("seed", range(5))
def test_a_clear_fit_is_told_as_by_the_general_way(seed, on_bound):
    s = solution(seed, on_bound=on_bound)
    of = (s, fitted(s), 1e-10)
    found = gain_ridges._known_singly(*of, OPTIONS)
    general = gain_ridges._assessed(*of, PERIOD_S, OPTIONS)
    assert found is not None
    np.testing.assert_allclose(found.errors, general.errors, rtol=1e-8)
    assert found.condition_number == pytest.approx(general.condition_number, rel=1e-8)
    assert found.identified.tolist() == general.identified.tolist()
    assert (found.reasons, found.ridges, found.combinations) == (general.reasons, (), ())


@pytest.mark.parametrize(("variance", "spread"), [(1e9, 1.0), (1e-10, 1e-9), (0.0, 1.0)])
def test_what_is_not_clear_goes_the_general_way(variance, spread):
    s = solution(1, spread=spread)
    assert gain_ridges._known_singly(s, fitted(s), variance, OPTIONS) is None
    found = gain_ridges.gain_identifiability(s, fitted(s), variance, PERIOD_S, OPTIONS)
    assert len(found.reasons) == 6


@pytest.mark.parametrize("spread", [1.0, 1e-3, 1e-9, 0.0])
def test_the_condition_number_is_that_of_the_singular_values(spread):
    gram = solution(2, spread=spread).gram[:5, :5]
    assert gain_ridges.gain_condition(gram) == pytest.approx(gram_condition(gram), rel=1e-6)
