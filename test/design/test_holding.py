# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Force of the pole with its magnet, and what its dimensions do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.design.field import make_model, solve_field
from valve_twin.design.geometry import HybridPole
from valve_twin.design.holding import (
    NEAR,
    PUBLISHED,
    changed,
    holding_forces,
    one_dimension,
    study,
)

POLE = HybridPole()
COARSE = 0.4


def test_forces_keep_near_what_was_measured_and_to_themselves():
    found = holding_forces(POLE, NEAR, fine=COARSE)
    for force, turns in zip(found, (0.0, 500.0, 1000.0, 1500.0), strict=True):
        assert 0.4 < force / PUBLISHED[NEAR, turns] < 1.0
    assert found[[0, 3]] == pytest.approx([117.8, 566.0], rel=0.04)  # regression, finer mesh


def test_a_force_is_the_slope_of_the_coenergy_over_the_gap():
    # another way than the stress in the stretched air: two meshes, two gaps
    def coenergy(gap):
        model = make_model(replace(POLE, gap=gap).section(), 1.0)
        return solve_field(model, [1000.0]).coenergy

    h = 2e-5
    slope = (coenergy(NEAR - h) - coenergy(NEAR + h)) / (2.0 * h)
    assert holding_forces(POLE, NEAR, [1000.0])[0] == pytest.approx(slope, rel=0.02)


def test_without_magnet_the_force_is_even_in_the_current():
    bare = changed(POLE, "magnet.remanence", 0.0)
    with_, against, nothing = holding_forces(bare, NEAR, [800.0, -800.0, 0.0], COARSE)
    assert with_ == pytest.approx(against, rel=1e-6)
    assert abs(nothing) < 1e-6


def test_a_stronger_magnet_and_a_smaller_gap_pull_more():
    effect = one_dimension(POLE, "magnet.remanence", fine=COARSE)
    assert effect.values == pytest.approx((1.107, 1.353))
    assert (effect.forces[1] > effect.forces[0]).all()
    near, far = (holding_forces(POLE, gap, [0.0], COARSE)[0] for gap in (NEAR, 1e-3))
    assert near > 1.5 * far


def test_a_change_that_does_not_fit_is_told_and_the_other_side_stands():
    effect = one_dimension(POLE, "magnet_height", turns=[0.0], fine=COARSE)
    assert np.isfinite(effect.forces[0]).all()
    assert np.isnan(effect.forces[1]).all()
    assert effect.error.startswith("magnet_height = 0.055: must be from 0 to")


def test_a_dimension_of_zero_only_grows():
    effect = one_dimension(POLE, "gap_4", turns=[1000.0], fine=COARSE)
    assert effect.values == (0.0, 1e-4)
    assert effect.forces[1, 0] < effect.forces[0, 0]


def test_an_unknown_number_is_refused():
    with pytest.raises(ValueError, match="'magnet_hight' is no number of the pole"):
        study(POLE, ["magnet_hight"])
