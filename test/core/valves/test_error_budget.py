# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The error budget: rows of the paper, sizes known from elsewhere, and what must be zero."""

from __future__ import annotations

import numpy as np
import pytest

from valve_twin.core.simulation import configure
from valve_twin.core.valves.error_budget import BudgetOptions, error_budget, row_count
from valve_twin.core.valves.positioner import MODEL as POSITIONER
from valve_twin.core.valves.press_cartridge import MODEL
from valve_twin.core.valves.press_cartridge.approximations import euler_error, press_approximations
from valve_twin.core.valves.press_cartridge.plant import PressCartridgePlant
from valve_twin.core.valves.registry import complete_options, get_simulation

THETA = ("theta_1", "theta_2", "theta_3", "theta_5")
QUIET = configure(MODEL.simulation(), {"measurement.noise": 1e-5})
OPTIONS = complete_options(MODEL, {})


def errors_of(budget, letter):
    """Return the relative errors of one row by parameter."""
    (row,) = [row for row in budget.rows if row.letter == letter]
    return dict(zip([c.parameter for c in budget.columns], row.errors, strict=True))


@pytest.fixture(scope="module")
def quiet():
    return error_budget(MODEL, OPTIONS, QUIET, BudgetOptions(realisations=3))


@pytest.fixture(scope="module")
def noisy():
    return error_budget(MODEL, OPTIONS, MODEL.simulation(), BudgetOptions(realisations=3))


def commands():
    """Return a rise, a hold and a return as held commands."""
    v = np.zeros((300, 2))
    v[20:60, 0] = 0.6
    v[60:90, 0] = np.linspace(0.3, 0.0, 30)
    v[180:195, 1] = 0.5
    return v


def test_it_has_the_rows_of_the_paper_for_gains_and_theta(quiet):
    assert "".join(row.letter for row in quiet.rows) == "abcdefghijk"
    assert len(quiet.rows) == row_count(MODEL, QUIET) == 11
    assert [c.parameter for c in quiet.columns] == ["K_in", "K_out", "leak", *THETA]


def test_an_offset_of_position_changes_nothing(quiet):
    # the regression is invariant (equations.md 2.4); the paper's 1e-6 is a floor
    assert max(errors_of(quiet, "c").values()) < 1e-6


def test_offsets_of_the_commands_move_theta_as_on_the_reference_valve(quiet, noisy):
    # equations.md 2.4, two layers, one cycle each: v_in: th2 0.21 %, th3 0.1 %, th5 0.2-0.5 %;
    # v_out: th2 0.3-1.4 %, th3 0.8-2.0 %, th5 1.9-8.4 %; factor 2 on the ends, other layers
    for budget in (quiet, noisy):
        inflow, outflow = errors_of(budget, "a"), errors_of(budget, "b")
        assert 1e-3 < inflow["theta_2"] < 5e-3
        assert 5e-4 < inflow["theta_3"] < 2e-3
        assert inflow["theta_5"] < 1e-2
        assert 1.5e-3 < outflow["theta_2"] < 2.8e-2
        assert 1e-3 < outflow["theta_3"] < 4e-2
        assert 5e-3 < outflow["theta_5"] < 1.7e-1


def test_compressibility_moves_theta_as_on_the_reference_valve(noisy):
    # equations.md 2.3: 3 % of theta_3, 13 % of theta_5; factor 3, the free run has no controller
    moved = errors_of(noisy, "k")
    assert 1e-2 < moved["theta_3"] < 9e-2
    assert 4e-2 < moved["theta_5"] < 4e-1


def test_theta_on_its_bound_moves_with_nothing_but_the_noise_that_put_it_there(noisy):
    column = [c.parameter for c in noisy.columns].index("theta_1")
    assert noisy.columns[column].value == pytest.approx(-1.0, abs=1e-9)
    assert noisy.largest(column).letter == "f"
    assert noisy.total(column) == pytest.approx(noisy.rows[5].errors[column])


def test_gains_withstand_the_noise_that_biases_theta(noisy):
    moved = errors_of(noisy, "f")
    assert moved["K_in"] < 0.01
    assert moved["theta_2"] > 0.1


def test_the_effect_of_an_offset_grows_in_proportion():
    both = [
        error_budget(MODEL, OPTIONS, QUIET, BudgetOptions(offset=size, realisations=2))
        for size in (5e-4, 1e-3)
    ]
    for letter in "ab":
        small, large = (errors_of(budget, letter) for budget in both)
        assert large["theta_2"] == pytest.approx(2.0 * small["theta_2"], rel=0.1)


def test_an_offset_of_the_measurement_layer_is_the_size_of_its_row():
    own = {"measurement.command_offsets": [0.0, 0.004], "measurement.position_offset": -0.02}
    budget = error_budget(MODEL, OPTIONS, configure(QUIET, own), BudgetOptions(realisations=2))
    sizes = {row.letter: row.size for row in budget.rows}
    assert (sizes["a"], sizes["b"], sizes["c"]) == (1e-3, 0.004, 0.02)


def test_a_total_is_the_sum_and_never_below_the_root_of_squares(noisy):
    for k in range(len(noisy.columns)):
        assert noisy.total(k) == pytest.approx(sum(row.errors[k] for row in noisy.rows))
        assert noisy.largest(k).errors[k] <= noisy.root_sum_square(k) <= noisy.total(k)


def test_the_same_seed_gives_the_same_budget(noisy):
    again = error_budget(MODEL, OPTIONS, MODEL.simulation(), BudgetOptions(realisations=3))
    assert again == noisy


def test_a_valve_without_taylor_polynomials_has_the_measured_rows():
    simulation = get_simulation("positioner")
    options = complete_options(POSITIONER, {})
    budget = error_budget(POSITIONER, options, simulation, BudgetOptions(realisations=2))
    assert "".join(row.letter for row in budget.rows) == "acdf"
    assert len(budget.rows) == row_count(POSITIONER, simulation)
    assert all(np.isfinite(row.errors).all() for row in budget.rows)


def test_a_cycle_that_cannot_be_estimated_says_why():
    still = {"program.targets": [0.0] * 5}
    budget = error_budget(MODEL, OPTIONS, configure(QUIET, still), BudgetOptions(realisations=2))
    assert budget.columns == ()
    assert budget.reason


def test_a_size_that_is_none_is_refused():
    with pytest.raises(ValueError, match=r"offset = 0\.0: must be above 0"):
        BudgetOptions(offset=0.0)
    with pytest.raises(ValueError, match=r"command_noise = 0\.0: must be above 0"):
        BudgetOptions(command_noise=0.0)
    with pytest.raises(ValueError, match="realisations = 1: must be 2 or more"):
        BudgetOptions(realisations=1)


def test_a_softer_fluid_compresses_more():
    # compressed volume goes with 1/beta
    stiff, soft = (
        {
            one.letter: one.error
            for one in press_approximations(
                PressCartridgePlant(bulk_modulus=beta), commands(), 0.03, {}
            )
        }
        for beta in (8e9, 2e9)
    )
    assert "g" not in stiff
    ratio = soft["k"].std() / stiff["k"].std()
    assert 2.5 < ratio < 5.5
    assert soft["h"] == pytest.approx(stiff["h"], abs=1e-12)


def test_the_rigid_valve_is_the_limit_of_the_stiff_one():
    plant = PressCartridgePlant(bulk_modulus=1e10, dead_volume=1e-5)
    made = {one.letter: one.error for one in press_approximations(plant, commands(), 0.03, {})}
    assert np.abs(made["k"]).max() < 2e-4


def test_the_euler_form_errs_in_proportion_to_the_sampling_time():
    # the same motion sampled twice as fast: rate and gains a sample scale, commands repeat
    theta = np.array([-0.4, 0.004, -0.02, 0.0])
    fine = theta * np.array([0.5, 0.25, 0.25, 0.25])
    coarse_error = euler_error(theta, commands())
    fine_error = euler_error(fine, np.repeat(commands(), 2, axis=0))
    assert fine_error.std() / coarse_error.std() == pytest.approx(0.5, abs=0.08)


def test_without_motion_no_approximation_matters():
    still = press_approximations(PressCartridgePlant(leak=0.0), np.zeros((50, 2)), 0.03, {})
    assert all(np.abs(one.error).max() < 1e-9 for one in still)
