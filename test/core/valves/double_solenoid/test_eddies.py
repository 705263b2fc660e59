# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Branches of eddy currents in the simulated valve: late flux, force from the flux."""

from __future__ import annotations

from dataclasses import replace
from operator import attrgetter

import numpy as np
import pytest

from test.core.valves.test_designed import FOUND
from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.physics.curves import force_of
from valve_twin.core.quantity import describe, replaced
from valve_twin.core.simulation import configure, simulate_cycles, to_frames
from valve_twin.core.types import Cycle, EstimateStatus
from valve_twin.core.valves.double_solenoid import MODEL
from valve_twin.core.valves.double_solenoid import plant_kernel as at
from valve_twin.core.valves.double_solenoid.control.kernel import drive_open_loop
from valve_twin.core.valves.double_solenoid.designed import plant_of
from valve_twin.core.valves.double_solenoid.eddies import (
    EddyConfig,
    driving,
    magnetising,
    step_branches,
)
from valve_twin.core.valves.double_solenoid.numbers import DoubleSolenoidNumbers
from valve_twin.core.valves.double_solenoid.parameters import constants_of
from valve_twin.core.valves.double_solenoid.plant import DoubleSolenoidPlant
from valve_twin.core.valves.double_solenoid.record import make_record
from valve_twin.core.valves.registry import complete_options, get_simulation

BRANCHES = (0.012, 4e-4, 0.035, 8e-3)
PLANT = plant_of(MODEL.of_design(replace(FOUND, eddies=BRANCHES)))

STIFF = replace(PLANT, spring_1=2e4, spring_2=2e4)
GROWN = replace(STIFF, eddies=EddyConfig(0.0028, 5e-4, 0.0072, 1.27e-2, 6.8))
NAMES = ("resistance_a", "resistance_b", "force_gain", "friction", "preload_1")


def cycles_of(plant, count, seed):
    """Return cycles of a plant, the first at rest left out."""
    config = replace(configure(get_simulation("double_solenoid"), {}), plant=plant)
    blocks = list(simulate_cycles(config, count + 1, seed))[1:]
    return [Cycle(k, config.period_s, to_frames(b)) for k, b in enumerate(blocks, 1)]


def options_for(plant, **given):
    names = [d.name for d in describe(DoubleSolenoidNumbers)]
    return complete_options(MODEL, {**{n: attrgetter(n)(plant) for n in names}, **given})


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


@pytest.mark.no_cover
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
    with pytest.raises(ValueError, match=r"gain_1 = 10.0.*at 2\.6 ohm and 2\.6 A is 3\.7e-06 s"):
        DoubleSolenoidPlant(eddies=EddyConfig(gain_1=10.0, time_1=1e-4))
    with pytest.raises(ValueError, match=r"growth = 100\.0: the fastest time .* and 2\.6 A"):
        DoubleSolenoidPlant(eddies=EddyConfig(gain_1=0.1, time_1=4e-4, growth=100.0))
    assert DoubleSolenoidPlant(eddies=EddyConfig(gain_1=0.1, time_1=4e-4)).eddies.growth == 0.0


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


def test_what_magnetises_is_exact_for_a_voltage_that_is_held():
    of, fast, slow = EddyConfig(*BRANCHES).numbers(), 0.01, -0.02
    seen, after_1, after_2 = magnetising(of, 1.0, 10.0, fast, slow, 1e-4)
    past, steps = [], 2000
    for _ in range(steps):
        before = fast + slow
        fast, slow = step_branches(of, fast, slow, 10.0, 1e-4 / steps)
        past.append(0.5 * (before + fast + slow))
    assert (after_1, after_2) == pytest.approx((fast, slow), rel=1e-4)
    assert seen == pytest.approx(1.0 - np.mean(past), rel=1e-5)


def test_a_record_holds_the_currents_that_magnetise_also_of_a_warm_coil():
    warm = replace(STIFF, resistance_a=1.3 * STIFF.resistance_a)
    (cycle,) = cycles_of(warm, 1, 3)
    known = np.ones(len(cycle.frames), dtype=np.bool_)
    apart = {}
    for name, plant in (("with", STIFF), ("without", replace(STIFF, eddies=EddyConfig()))):
        record = make_record(cycle.frames, known, cycle.period_s, plant)
        apart[name] = record.drawn[:, 0] - record.current_a
    assert not apart["without"].any()
    rest = apart["with"][-300:]  # the spool stands, the coil is 30 % off its option
    assert np.abs(rest.mean()) < 5e-3
    assert np.abs(apart["with"]).max() > 0.2


@pytest.mark.no_cover
def test_the_free_run_of_a_twin_that_knows_them_follows_the_valve():
    for options, least, most in (
        (options_for(STIFF), 97.0, 100.0),
        (options_for(replace(STIFF, eddies=EddyConfig())), -np.inf, 90.0),
    ):
        first, second = cycles_of(STIFF, 2, 5)
        _, memory = estimate_cycle(MODEL, options, first, Memory.empty())
        (done,), _ = estimate_cycle(MODEL, options, second, memory)
        assert least < done.fit_test < most


def test_the_gains_grow_with_the_current_that_magnetises():
    of = EddyConfig(*BRANCHES, growth=3.0).numbers()
    assert driving(of, 0.5, 10.0) == 25.0
    assert driving(of, -0.5, 10.0) == 10.0  # below none there is nothing to grow with
    constant = EddyConfig(*BRANCHES).numbers()
    seen, *after = magnetising(of, 1.0, 10.0, 0.01, -0.02, 1e-4)
    same = magnetising(constant, 1.0, driving(of, seen, 10.0), 0.01, -0.02, 1e-4)
    assert (seen, *after) == pytest.approx(same, rel=1e-12)


@pytest.mark.no_cover
def test_a_twin_that_does_not_know_how_they_grow_does_not_follow_the_valve():
    fits = []
    for known in (GROWN, STIFF):
        first, second = cycles_of(GROWN, 2, 5)
        _, memory = estimate_cycle(MODEL, options_for(known), first, Memory.empty())
        (done, *_), _ = estimate_cycle(MODEL, options_for(known), second, memory)
        fits.append(done.fit_test)
    assert fits[0] > 97.0
    assert fits[1] < 90.0


@pytest.mark.no_cover
@pytest.mark.parametrize(("plant", "seed"), [("STIFF", 821), ("STIFF", 822), ("STIFF", 823),
                                             ("GROWN", 824), ("GROWN", 825)])  # fmt: skip
def test_a_twin_that_knows_them_withholds_nothing_of_a_valve_that_has_aged(plant, seed):
    rng, known = np.random.default_rng(seed), {"STIFF": STIFF, "GROWN": GROWN}[plant]
    truth = {n: getattr(known, n) * rng.uniform(0.85, 1.15) for n in NAMES}
    (cycle,) = cycles_of(replaced(known, truth), 1, seed)
    (found,) = MODEL.estimate(cycle, options_for(known))
    assert found.status is EstimateStatus.ACCEPTED, found.reason
    for p in found.parameters:
        if p.name in truth:
            assert p.lower_95 <= truth[p.name] <= p.upper_95, p.name
    (blind,) = MODEL.estimate(cycle, options_for(replace(STIFF, eddies=EddyConfig())))
    assert blind.status is EstimateStatus.PARTIAL


@pytest.mark.no_cover
def test_a_tolerance_of_the_branches_widens_what_the_motion_tells():
    (cycle,) = cycles_of(STIFF, 1, 7)
    none = {f"tolerances.eddies.{n}": 0.0 for n in ("gain_1", "time_1", "gain_2", "time_2")}
    half = []
    for given in (none, {}):
        (found,) = MODEL.estimate(cycle, options_for(STIFF, **given))
        of = {p.name: p for p in found.parameters}["friction"]
        half.append(of.upper_95 - of.lower_95)
    assert half[1] > 1.1 * half[0]  # by what a cycle leaves open


@pytest.mark.no_cover
def test_a_growth_that_the_twin_does_not_know_exactly_is_a_doubt_of_the_friction():
    (cycle,) = cycles_of(GROWN, 1, 7)
    half = []
    for width in (0.0, 0.5):
        (found,) = MODEL.estimate(cycle, options_for(GROWN, **{"tolerances.eddies.growth": width}))
        of = {p.name: p for p in found.parameters}["friction"]
        assert of.lower_95 <= GROWN.friction <= of.upper_95
        half.append(of.upper_95 - of.lower_95)
    assert half[1] > 1.1 * half[0]
    names = constants_of(options_for(GROWN)).names
    assert [n for n in names if "growth" in n] == ["eddies.growth"]


def test_without_them_no_constant_of_theirs_is_in_doubt():
    assert not [n for n in constants_of(options_for(DoubleSolenoidPlant())).names if "eddies" in n]
    assert [n for n in constants_of(options_for(STIFF)).names if "eddies" in n] == [
        f"eddies.{n}" for n in ("gain_1", "time_1", "gain_2", "time_2")
    ]
