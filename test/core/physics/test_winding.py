# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The orthocyclic winding of paper 000, eq. (3)."""

from __future__ import annotations

import math

import pytest

from valve_twin.core.physics.winding import wind


def test_one_layer_is_as_high_as_its_wire():
    of = wind(40, 0.5e-3, 0.45e-3, 20e-3, 10e-3)
    assert of.layers == 1
    assert of.height == pytest.approx(0.5e-3)
    metres = 40 * 2.0 * math.pi * 10.25e-3
    assert of.resistance == pytest.approx(1.72e-8 * metres / (math.pi * (0.225e-3) ** 2))


def test_the_next_turn_opens_a_layer_in_the_valleys_of_the_last():
    of = wind(41, 0.5e-3, 0.45e-3, 20e-3, 10e-3)
    assert of.layers == 2
    assert of.height == pytest.approx((1.0 + math.sin(math.radians(60.0))) * 0.5e-3)


def test_a_hot_coil_has_more_resistance():
    cold = wind(350, 0.5e-3, 0.45e-3, 20e-3, 10e-3)
    hot = wind(350, 0.5e-3, 0.45e-3, 20e-3, 10e-3, temperature=60.0)
    assert hot.resistance / cold.resistance == pytest.approx(1.0 + 40.0 * 3.93e-3)


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ((0, 0.5e-3, 0.45e-3, 20e-3, 10e-3), "turns = 0: must be 1 or more"),
        ((10, 0.5e-3, 0.6e-3, 20e-3, 10e-3), "copper = 0.0006: must be above 0, at most 0.0005"),
        ((10, 0.5e-3, 0.45e-3, 0.1e-3, 10e-3), "wire = 0.0005: must be above 0, at most 0.0001"),
        ((10, 0.5e-3, 0.45e-3, 20e-3, math.nan), "inner_radius = nan"),
    ],
)
def test_what_is_no_winding_is_refused_by_name(numbers, words):
    with pytest.raises(ValueError, match=words):
        wind(*numbers)
