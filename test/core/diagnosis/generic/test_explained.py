# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How much of what a cycle differs from its model each fault explains."""

import numpy as np
import pytest

from valve_twin.core.diagnosis.generic.explained import EXPLAINED, NAMED, explained, values
from valve_twin.core.diagnosis.generic.faults import FAULTS, Sensed, slipping, source
from valve_twin.core.diagnosis.generic.features import Record
from valve_twin.core.diagnosis.table import BY_NAME

PERIOD_S = 0.05
SIZES = {
    "sensor_gain": -0.05,
    "command_loss": 0.9,
    "oscillation": 0.03,
    "lost_motion": 0.05,
    "end_stop_upper": 0.05,
    "end_stop_lower": 0.05,
    "delay": 0.2,
    "slow": 0.6,
    "slow_up": 0.6,
    "slow_down": 0.6,
}


def record(motion, fault="", size=0.0, *, noise=1e-3, sag=0.0, level=0.0):
    """A cycle under a fault, against a model that lacks a sag in mid-stroke and a level."""
    share = motion / np.ptp(motion)
    off = noise * np.random.default_rng(8).standard_normal(len(motion))
    true = share + sag * np.sin(np.pi * share)
    shown = Sensed(true, off, PERIOD_S, source(3, 1))
    measured = FAULTS[fault](shown, size) if fault else true + off
    return Record(40.0 * (measured + level), 40.0 * share, PERIOD_S, np.zeros((len(motion), 0)))


def test_every_fault_that_is_told_has_a_name():
    assert set(NAMED) <= set(BY_NAME)
    assert set(SIZES) | {"sticking"} == set(NAMED)


@pytest.mark.parametrize(("fault", "size"), SIZES.items())
def test_a_fault_explains_its_own_cycles_best_also_of_a_model_that_errs(motion, fault, size):
    sound = explained(record(motion, sag=0.01, level=0.03))
    found = explained(record(motion, fault, size, sag=0.01, level=-0.02))
    more = {n: found[n] - sound[n] for n in NAMED}
    assert max(more, key=lambda n: more[n]) == fault
    assert more[fault] > 1.0


@pytest.mark.parametrize("jump", [1.0 / 3.0, 1.0])
def test_what_sticks_and_slips_explains_its_own_cycles_best(motion, jump):
    share = motion / np.ptp(motion)
    noise = 1e-3 * np.random.default_rng(8).standard_normal(len(motion))
    stuck = slipping(share, 0.2, jump) + noise
    found = explained(Record(stuck, share, PERIOD_S, np.zeros((len(motion), 0))))
    assert max(found, key=lambda n: found[n]) == "sticking"


def test_a_cycle_like_its_model_has_nothing_to_explain(motion):
    assert max(explained(record(motion, noise=1e-4)).values()) < 0.1


def test_the_unit_and_the_level_of_the_position_say_nothing(motion):
    first = record(motion, "delay", 0.2)
    scaled = Record(3.0 * first.position + 7.0, 3.0 * first.response, PERIOD_S, first.commands)
    assert explained(scaled) == pytest.approx(explained(first), rel=1e-9, abs=1e-12)


def test_samples_that_are_missing_are_left_out(motion):
    whole = record(motion, "slow", 0.6)
    lost = whole.position.copy()
    lost[::50] = np.nan
    found = explained(Record(lost, whole.response, PERIOD_S, whole.commands))
    assert found["slow"] == pytest.approx(explained(whole)["slow"], rel=0.1)


def test_a_long_cycle_is_thinned_and_says_the_same(motion):
    place = np.arange(len(motion) * 10) / 10.0
    fine = np.interp(place, np.arange(len(motion)), motion)
    found = explained(
        Record(40.0 * np.roll(fine, 40), 40.0 * fine, PERIOD_S / 10.0, np.zeros((len(fine), 0)))
    )
    assert max(found, key=lambda n: found[n]) == "delay"


@pytest.mark.parametrize("count", [0, 10, 400])
def test_a_cycle_that_shows_nothing_is_not_known(count):
    flat = np.ones(count)
    assert values(Record(flat, flat, PERIOD_S, np.zeros((count, 0)))) == []


def test_as_parameters_they_are_numbers_with_a_name(motion):
    found = values(record(motion, "delay", 0.2))
    assert [p.name for p in found] == [f"{EXPLAINED}{n}" for n in explained(record(motion))]
    assert all(type(p.value) is float and p.value >= 0.0 for p in found)
