# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import numpy as np
import pytest

from valve_twin.core.aging.config import LAWS
from valve_twin.core.aging.laws.shapes import condense, curves, grid


def test_every_shape_runs_from_nothing_to_one_and_rises():
    law, number, prior = grid(())
    g = curves(law, number, np.linspace(0.0, 1.0, 50))
    assert g[:, 0] == pytest.approx(np.zeros(len(law)))
    assert g[:, -1] == pytest.approx(np.ones(len(law)))
    assert np.all(np.diff(g, axis=1) > 0.0)
    assert prior.sum() == pytest.approx(1.0)


def test_bent_shapes_bend_as_they_are_named():
    law, number, _ = grid(())
    second = np.diff(curves(law, number, np.linspace(0.1, 1.0, 9)), 2)
    sign = np.sign(second).mean(axis=1)
    for place, name in enumerate(LAWS):
        own = law == place
        wanted = {"exponential": 1.0, "saturating": -1.0}.get(name)
        if wanted is not None:
            assert np.all(sign[own] == wanted)
    power = law == LAWS.index("power")
    assert np.all(sign[power] == np.sign(number[power] - 1.0))


def test_only_the_laws_that_are_allowed_are_tried():
    law, _, prior = grid(("line", "saturating"))
    assert {LAWS[i] for i in law} == {"line", "saturating"}
    assert prior.sum() == pytest.approx(1.0)


def test_a_long_history_is_condensed_to_means_that_keep_the_newest():
    x = np.arange(1001.0)
    place, mean = condense(x, 2.0 * x, most=100)
    assert len(place) == 91
    assert place[-1] == np.mean(x[-11:])
    assert mean == pytest.approx(2.0 * place)
    assert condense(x[:100], x[:100], most=100)[0] is not None
    assert len(condense(x[:100], x[:100], most=100)[0]) == 100
