# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Limits, front and hypervolume."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from valve_twin.design.search.front import (
    WORST,
    Limits,
    agree,
    chosen_of,
    front_of,
    hypervolume,
    objectives,
)
from valve_twin.design.search.tasks import Outcome

REFERENCE = {"rise_s": 2.0, "settling_s": 4.0, "graded_s": 4.0, "loss": 1.0}


def outcome(rise, settling, loss):
    figures = {"rise_s": rise, "settling_s": settling, "graded_s": settling, "loss": loss,
               "overshoot": 0.01, "error": 0.0, "heating": 10.0, "margin": 50.0}  # fmt: skip
    return Outcome(f"{rise} {settling} {loss}", "search", {}, figures)


def test_the_front_holds_what_nothing_beats():
    a, b, c = outcome(1.0, 4.0, 1.0), outcome(2.0, 2.0, 1.0), outcome(2.0, 4.0, 0.5)
    beaten, twin = outcome(2.1, 2.0, 1.0), outcome(2.0, 2.0, 1.0)
    assert front_of([beaten, c, b, a], Limits(), REFERENCE) == (a, b, c)
    assert front_of([b, twin], Limits(), REFERENCE) == (twin,)
    assert front_of([], Limits(), REFERENCE) == ()


@pytest.mark.parametrize(
    ("others", "said"),
    [
        ({"overshoot": 0.06}, "overshoot = 0.06: must be 0.05 or less"),
        ({"error": 0.03}, "error = 0.03: must be 0.02 or less"),
        ({"loss": 1.2}, "loss = 1.2: must be 1.15 or less"),
        ({"heating": 70.0}, "heating = 70: must be 60 or less"),
        ({"margin": 10.0}, "margin = 10: must be 20 or more"),
    ],
)
def test_every_limit_keeps_a_design_off_the_front_and_is_named(others, said):
    usual = outcome(1.0, 1.0, 1.0)
    of = replace(usual, figures={**usual.figures, **others})
    assert front_of([of], Limits(), REFERENCE) == ()
    assert Limits().said(of, REFERENCE) == said
    assert sum(v > 0.0 for v in Limits().broken(of, REFERENCE).values()) == 1


def test_a_failed_design_breaks_all_limits_the_more_the_worse_its_geometry():
    failed = Outcome("a", "search", error="why")
    worse = Outcome("b", "search", error="why", broken=0.5)
    one, other = (sum(Limits().broken(of, REFERENCE).values()) for of in (failed, worse))
    assert other > one > 5.0
    assert list(Limits().broken(failed, REFERENCE)) == list(
        Limits().broken(outcome(1.0, 1.0, 1.0), REFERENCE)
    )


def test_the_hypervolume_of_boxes_is_that_of_their_union():
    one = outcome(1.0, 4.0, 1.0)  # objectives 0.5, 1, 1
    two = outcome(2.0, 2.0, 1.0)  # 1, 0.5, 1
    sides = WORST - objectives(one, REFERENCE)
    assert hypervolume([one], REFERENCE) == pytest.approx(np.prod(sides))
    both = 2 * np.prod(sides) - (WORST - 1.0) ** 3
    assert hypervolume([one, two], REFERENCE) == pytest.approx(both)
    assert hypervolume([], REFERENCE) == 0.0


def test_the_chosen_design_is_good_in_rise_and_settling_both():
    one, two, both = outcome(1.0, 4.0, 1.0), outcome(2.0, 2.0, 0.9), outcome(1.6, 3.0, 1.0)
    assert chosen_of([one, two, both], REFERENCE) is both


@pytest.mark.parametrize(
    ("other", "alike"),
    [
        ({"rise_s": 3.19e-3}, True),
        ({"rise_s": 3.21e-3}, False),  # 3 % and 0.2 ms of 3 ms
        ({"settling_s": 9.26e-3}, True),
        ({"settling_s": 9.30e-3}, False),
        ({"settling_s": math.inf}, False),
        ({"graded_s": 1.0}, True),
        ({"overshoot": 0.0305}, False),
    ],
)
def test_designs_agree_on_two_meshes_within_what_is_promised(other, alike):
    usual = outcome(3e-3, 9e-3, 1.0)
    usual = replace(usual, figures={**usual.figures, "overshoot": 0.02})
    assert agree(replace(usual, figures={**usual.figures, **other}), usual) == alike
    assert not agree(Outcome("a", "twice", error="why"), usual)


def test_a_limit_outside_its_range_is_refused():
    with pytest.raises(ValueError, match=r"Limits.overshoot = -0.1: must be a number from 0 to 1"):
        Limits(overshoot=-0.1)


def test_a_figure_that_is_no_number_keeps_no_limit_and_is_no_objective():
    figures = {"rise_s": 1.0, "settling_s": 1.0, "graded_s": 1.0, "loss": math.nan,
               "overshoot": 0.0, "error": 0.0, "heating": 1.0, "margin": 50.0}  # fmt: skip
    of, reference = Outcome("a", "search", {}, figures), {**figures, "loss": 1.0}
    assert not Limits().keeps(of, reference)
    assert front_of([of], Limits(), reference) == ()
    assert np.isfinite(objectives(of, reference)).all()
