# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The free run of an ARX model is what SciPy's filter makes of it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter, lfiltic

from test.programmed import programmed
from valve_twin.core.estimation.solvers.arx import Arx, fit_arx

FEEDBACK = np.array([-1.5, 0.8, -0.1])


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("commands", [1, 2])
@pytest.mark.parametrize("delay", [0, 4])
def test_free_run_is_that_of_a_filter(order, commands, delay):
    rng = np.random.default_rng(7)
    u, y = rng.normal(size=(200, commands)), rng.normal(size=200)
    made = Arx(0.5 * FEEDBACK[:order], rng.normal(size=(commands, order)), 0.3, delay)
    drive = np.full(200, made.level)
    for b, one in zip(made.b, u.T, strict=True):
        late = np.concatenate([np.full(delay, one[0]), one])[:200]
        drive += lfilter(b, [1.0], late, zi=lfiltic(b, [1.0], [], [one[0]] * order))[0]
    back = np.concatenate([[1.0], made.a])
    state = lfiltic([1.0], back, y[:order][::-1])
    expected = lfilter([1.0], back, drive[order:], zi=state)[0]
    given = u[:, 0] if commands == 1 else u
    found = made.free_run(given, y)
    np.testing.assert_array_equal(found[:order], y[:order])
    np.testing.assert_allclose(found[order:], expected, rtol=1e-12, atol=1e-12)


def test_the_model_that_made_the_data_is_found():
    rng = np.random.default_rng(11)
    u = np.repeat(rng.normal(size=30), 20)
    true = Arx(FEEDBACK, np.array([[0.1, 0.05, 0.02]]), 0.2, 3)
    y = true.free_run(u, np.zeros(600))
    found = fit_arx(u, y, (0, 3))
    assert found is not None
    assert found.delay == 3
    np.testing.assert_allclose(found.a, true.a, atol=1e-6)
    np.testing.assert_allclose(found.b, true.b, atol=1e-6)


def test_a_free_run_does_not_load_what_filters_signals():
    """SciPy's loads nearly all of it: a third of a verb that lasts a second."""
    code = (
        "import sys, numpy as np;"
        "from valve_twin.core.estimation.solvers.arx import fit_arx;"
        "u = np.repeat(np.random.default_rng(1).normal(size=20), 10);"
        "assert fit_arx(u, np.concatenate([np.zeros(1), u[:-1]]), (0, 1)) is not None;"
        "print('scipy.signal' in sys.modules)"
    )
    assert programmed(code) == "False\n"
