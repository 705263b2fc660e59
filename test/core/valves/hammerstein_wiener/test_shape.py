# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The numbers of a Hammerstein-Wiener model: poles, curves, and the way back."""

import numpy as np
import pytest

from valve_twin.core.valves.hammerstein_wiener.kernels import (
    INPUT,
    OUTPUT,
    SIZE,
    A,
    curve,
    inverse,
)
from valve_twin.core.valves.hammerstein_wiener.shape import (
    Ranges,
    Shape,
    bounds_of,
    coefficients_of,
    feedback_of,
    numbers_of,
    reflections_of,
)

RANGES = Ranges((-1.0, 3.0), (10.0, 14.0))
WHOLE = Shape(2, 3, rates=True, curved=True, bent=True)


def drawn(seed):
    rng = np.random.default_rng(seed)
    lower, upper = bounds_of(WHOLE)
    return rng.uniform(np.maximum(lower, -2.0), np.minimum(upper, 2.0))


@pytest.mark.parametrize("seed", range(50))
def test_every_pole_is_inside_the_unit_circle(seed):
    a = coefficients_of(drawn(seed), WHOLE, RANGES)[A : A + 3]
    assert np.abs(np.roots([1.0, *a])).max() < 1.0


def test_reflections_are_those_of_the_textbook():
    k = np.array([0.5, -0.3])  # 1 + k1 (1 + k2) q^-1 + k2 q^-2
    assert feedback_of(k) == pytest.approx([0.5 * 0.7, -0.3])
    assert reflections_of(feedback_of(k)) == pytest.approx(k)


@pytest.mark.parametrize("seed", range(5))
def test_numbers_lead_to_coefficients_and_back(seed):
    z = drawn(seed)
    c = coefficients_of(z, WHOLE, RANGES)
    assert numbers_of(c, WHOLE, RANGES) == pytest.approx(z, abs=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_the_curve_of_the_output_rises_and_is_inverted(seed):
    c = coefficients_of(drawn(seed), WHOLE, RANGES)[OUTPUT:SIZE]
    levels = np.linspace(8.0, 16.0, 40)
    places = np.array([inverse(float(y), c) for y in levels])
    assert (np.diff(places) > 0.0).all()
    assert [curve(float(x), c) for x in places] == pytest.approx(levels.tolist())


def test_the_curve_of_the_command_goes_through_its_knots_and_on_straight():
    c = coefficients_of(drawn(1), WHOLE, RANGES)[INPUT:OUTPUT]
    knots = np.linspace(*RANGES.command, int(c[0]))
    levels = c[3 : 3 + int(c[0])]
    assert [curve(float(u), c) for u in knots] == pytest.approx(levels.tolist())
    step = knots[1] - knots[0]
    assert curve(knots[-1] + step, c) == pytest.approx(2.0 * levels[-1] - levels[-2])
