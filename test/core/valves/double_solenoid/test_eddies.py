# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Branches of eddy currents in the simulated valve: late flux, force from the flux."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from test.core.valves.test_designed import FOUND
from valve_twin.core.physics.curves import force_of
from valve_twin.core.valves.double_solenoid import MODEL
from valve_twin.core.valves.double_solenoid import plant_kernel as at
from valve_twin.core.valves.double_solenoid.control.kernel import drive_open_loop
from valve_twin.core.valves.double_solenoid.designed import plant_of
from valve_twin.core.valves.double_solenoid.eddies import EddyConfig, step_branches
from valve_twin.core.valves.double_solenoid.plant import DoubleSolenoidPlant

BRANCHES = (0.012, 4e-4, 0.035, 8e-3)
PLANT = plant_of(MODEL.of_design(replace(FOUND, eddies=BRANCHES)))


def open_loop(command):
    state = np.split(PLANT.initial_state(), 2)[0]
    found = np.empty((len(command), at.STATE_SIZE))
    gains = PLANT.current_gains()
    drive_open_loop(state, PLANT.valve(), PLANT.tables(), gains, command, found)
    return found


def test_a_branch_follows_the_voltage_with_its_time():
    fast, slow = 0.0, 0.0
    for _ in range(400):
        fast, slow = step_branches(EddyConfig(*BRANCHES).numbers(), fast, slow, 10.0, 1e-6)
    assert fast == pytest.approx(0.12 * (1.0 - np.exp(-1.0)), rel=2e-3)
    assert slow == pytest.approx(0.35 * (1.0 - np.exp(-0.05)), rel=2e-3)


def test_the_force_is_that_of_the_currents_that_magnetise():
    found = open_loop(np.full(30, 0.4))
    assert not found[:, at.FAILED].any()
    late = found[:, at.I_A] - found[:, at.GF_1]
    assert np.abs(late[:5]).max() > 0.05  # the flux rises after the current
    for s in found[::7]:
        wanted = force_of(PLANT.tables(), s[at.GF_1], s[at.GF_2], s[at.X])
        assert s[at.FORCE] == pytest.approx(wanted, abs=0.2)  # the place moves in a sub-step


def test_at_rest_there_are_no_eddy_currents():
    state = PLANT.initial_state()[: at.STATE_SIZE]
    assert state[[at.GA_1, at.GA_2, at.GB_1, at.GB_2]].tolist() == [0.0] * 4
    assert state[at.GF_1] == PLANT.bias_current


def test_the_loop_reaches_its_place_with_them():
    of = MODEL.loop(MODEL.of_design(replace(FOUND, eddies=BRANCHES)), 0.5, {})
    assert of.error < 0.05
    assert of.rise_s < 0.02


def test_a_time_that_the_step_cannot_follow_is_refused():
    with pytest.raises(ValueError, match="time_1"):
        EddyConfig(time_1=1e-6)


def test_branches_that_the_step_cannot_follow_in_the_coil_are_refused():
    with pytest.raises(ValueError, match=r"gain_1 = 10.0.*fastest time at 2\.6 ohm is 3\.7e-06 s"):
        DoubleSolenoidPlant(eddies=EddyConfig(gain_1=10.0, time_1=1e-4))


def test_a_slower_branch_alone_is_refused():
    with pytest.raises(ValueError, match=r"gain_2 = 0\.5: needs gain_1 above 0"):
        EddyConfig(gain_2=0.5)


def test_coils_of_a_table_that_drive_each_other_up_are_refused_with_them_too():
    currents, places = (0.0, 0.5, 1.0, 2.0, 4.0, 6.0), np.linspace(-9.6e-4, 9.6e-4, 5)
    flux = np.outer(0.1 * np.tanh(np.array(currents) / 3.0), 1.0 + 200.0 * places)
    with pytest.raises(ValueError, match=r"map_mutual = 0\.3: must be within"):
        DoubleSolenoidPlant(
            map_current=currents,
            map_position=tuple(places.tolist()),
            map_flux=tuple(flux.ravel().tolist()),
            map_mutual=0.3,
            eddies=EddyConfig(*BRANCHES),
        )
