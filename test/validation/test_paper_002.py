# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Paper 002: what agrees, what cannot, and that the comparison would notice a wrong number."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from valve_twin.validation import Check, Verdict, get_paper, paper_numbers
from valve_twin.validation.layers_002 import (
    FIRST_CYCLE,
    FREQUENCIES,
    Layer,
    fit_layer,
    line_share,
    power_spectrum,
    strongest,
)
from valve_twin.validation.paper_002 import fig_5, pole_checks, table_1, table_4, table_5
from valve_twin.validation.theory_002 import corner_theta, pole_frequency_hz

if TYPE_CHECKING:
    from collections.abc import Sequence

CYCLES = 30


def nothing() -> None:
    """Take no notice of the advance."""


def find(checks: Sequence[Check], quantity: str) -> Check:
    (found,) = [check for check in checks if check.quantity == quantity]
    return found


@pytest.fixture(scope="module")
def fits():
    return fit_layer(Layer("refresh 3, noise 4e-3", 0, 3, 4e-3), CYCLES, 7, nothing)


def test_a_comparison_passes_inside_its_limits_only():
    check = Check("Table 0", "x", 1.0, 1.05, 0.9, 1.1)
    assert check.verdict is Verdict.PASS
    assert replace(check, obtained=1.2).verdict is Verdict.FAIL
    assert replace(check, obtained=float("nan")).verdict is Verdict.FAIL
    assert replace(check, lower=float("nan")).verdict is Verdict.CANNOT


def test_an_unknown_paper_is_refused_with_those_that_are_known():
    with pytest.raises(ValueError, match=r"no paper '999'; known are .*\b002\b"):
        get_paper("999")


@pytest.mark.parametrize("number", paper_numbers())
def test_every_paper_is_registered_under_its_own_number(number):
    assert get_paper(number).number == number


def test_the_paper_is_reproduced_in_every_row_that_can_be(recomputed):
    checks = recomputed("002")
    assert [c for c in checks if c.verdict is Verdict.FAIL] == []
    items = {c.item.split(",")[0] for c in checks}
    assert {"Table 1", "Table 3", "Table 4", "Table 5", "Section 4.1", "Fig. 5"} <= items
    assert all(c.note for c in checks if c.verdict is Verdict.CANNOT)


def test_the_corners_of_the_box_are_those_of_the_reference_computation():
    # equations.md 2.2 (1), (2): three digits
    box = corner_theta(identical=True)
    assert box.min(axis=0)[[0, 1, 2, 4]] == pytest.approx([-859, 0.0197, -3.68, 0.0120], rel=4e-3)
    assert box.max(axis=0)[[0, 1, 2, 4]] == pytest.approx([-0.56, 0.845, -0.112, 0.687], rel=5e-3)
    own = corner_theta(identical=False)
    assert own[:, 1].min() == pytest.approx(0.0072, rel=6e-3)
    assert own[:, 2].max() == pytest.approx(-0.0104, rel=3e-3)


def test_the_signs_of_theta_are_those_of_physics():
    box = corner_theta(identical=False)
    assert (np.sign(box) == [-1, 1, -1, -1, 1]).all()


def test_any_negative_pole_rings_at_half_the_sampling_frequency():
    assert pole_frequency_hz(-0.16) == pole_frequency_hz(-0.9) == pytest.approx(1.0 / 0.06)
    assert pole_frequency_hz(0.5) == 0.0
    assert all(c.verdict is Verdict.PASS for c in pole_checks())


def test_only_the_misprinted_total_of_table_5_cannot_be_reproduced():
    checks = table_5()
    assert find(checks, "total of theta_1").verdict is Verdict.CANNOT
    assert find(checks, "total of theta_1").obtained == pytest.approx(1.108e-3)
    totals = [find(checks, f"total of theta_{k}") for k in (2, 3, 5)]
    assert [c.verdict for c in totals] == [Verdict.PASS] * 3
    assert [c.obtained for c in totals] == pytest.approx([6.64e-2, 1.83e-1, 5.46e-1], rel=3e-3)


def test_table_4_agrees_but_where_forward_euler_or_the_box_does_not_reach():
    refused = [c.quantity for c in table_4() if c.verdict is Verdict.CANNOT]
    assert refused[:3] == ["theta_1 lower end", "theta_1 upper end", "theta_2 lower end"]
    assert all(c.verdict is not Verdict.FAIL for c in table_4())


def test_white_noise_has_its_share_and_a_line_all_of_the_power():
    noise = np.random.default_rng(3).standard_normal(60000)
    assert line_share(noise) == pytest.approx(0.047, abs=0.006)  # 3 sd: 0.047/sqrt(1410) * 3
    assert line_share(np.cos(2.0 * np.pi * np.arange(900) / 3.0)) == pytest.approx(1.0)


def test_the_spectrum_shows_a_line_where_it_is():
    assert power_spectrum(np.random.default_rng(1).standard_normal(999)).sum() == pytest.approx(1)
    line = power_spectrum(np.cos(2.0 * np.pi * 0.2 * np.arange(900)))
    assert strongest(line) == pytest.approx(0.2, abs=0.5 / FREQUENCIES)


def test_a_stale_sensor_drives_least_squares_below_its_bound(fits):
    # equations.md 2.4, refresh 3, noise 4e-3: -1.24 and -1.26 over 105 cycles
    assert fits.mean("LS3", 1) == pytest.approx(-1.24, abs=0.03)
    assert fits.mean("LS5", 1) == pytest.approx(-1.26, abs=0.03)
    assert (np.abs(fits.theta["QP4"][:, 0] + 1.0) < 1e-9).all()
    assert fits.line.mean() > 0.094


def test_a_layer_without_noise_fails_table_1():
    quiet = fit_layer(Layer("quiet", 1, 1, 1e-5), 3, 1, nothing)
    failed = {c.quantity for c in table_1(quiet) if c.verdict is Verdict.FAIL}
    assert {"LS3 theta_1", "LS5 theta_1", "QP4 theta_1", "LS3 MSE training"} <= failed


def test_a_valve_that_does_not_age_fails_fig_5(fits):
    assert find(fig_5(fits), "error probability of a trend of theta_2").verdict is Verdict.PASS
    theta = {name: np.roll(values[::-1], 7, axis=0) for name, values in fits.theta.items()}
    drift = find(fig_5(replace(fits, theta=theta)), "drift of theta_2 [%]")
    assert drift.verdict is Verdict.FAIL


def test_cycles_are_those_of_the_paper(fits):
    assert fits.cycles[0] == FIRST_CYCLE
    assert fits.cycles[-1] == FIRST_CYCLE + CYCLES - 1
