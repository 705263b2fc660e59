# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Eddy currents that differ from the options are found in a cycle, and followed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from test.core.valves.double_solenoid.test_eddies import STIFF, cycles_of, options_for
from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.quantity import replaced
from valve_twin.core.types import EstimateStatus
from valve_twin.core.valves.double_solenoid import MODEL
from valve_twin.core.valves.double_solenoid.eddy.fit import fit_eddies
from valve_twin.core.valves.double_solenoid.parameters import BRANCHES
from valve_twin.core.valves.double_solenoid.record import make_record, warm_resistances

OFF = dict(zip(BRANCHES, (1.04, 0.96, 0.96, 1.04), strict=True))
"""Of the valve over the options."""

WIDTHS = np.full(4, 0.05)


def changed(plant):
    values = {f"eddies.{n}": share * getattr(plant.eddies, n) for n, share in OFF.items()}
    return replaced(plant, values)


def fitted(plant, options, widths=WIDTHS, bad=()):
    (cycle,) = cycles_of(plant, 1, 4)
    known = np.ones(len(cycle.frames), dtype=np.bool_)
    known[list(bad)] = False
    record = make_record(cycle.frames, known, cycle.period_s, options)
    return fit_eddies(record, options, warm_resistances(record, options), widths)


def numbers(of):
    return np.array([getattr(of, n) for n in BRANCHES])


def test_branches_are_found_within_three_errors():
    there = changed(STIFF)
    found = fitted(there, STIFF)
    off = np.log(found.numbers / numbers(there.eddies))
    assert (np.abs(off) < 3.0 * found.errors).all()
    assert (found.errors < np.array([0.012, 0.03, 0.012, 0.012])).all()
    assert np.abs(off[2:]).max() < 0.01  # from 4 %


def test_a_number_that_is_known_stays_as_it_is_and_none_leaves_its_tolerance():
    widths = np.array([0.0, 0.05, 0.02, 0.05])
    found = fitted(changed(STIFF), STIFF, widths)
    assert found.numbers[0] == pytest.approx(STIFF.eddies.gain_1, rel=1e-9)
    assert found.errors[0] == 0.0
    assert found.numbers[2] == pytest.approx(np.exp(-0.02) * STIFF.eddies.gain_2)


@pytest.mark.parametrize(("name", "limit"), [("time_1", 1e-4), ("time_2", 1.0)])
def test_none_leaves_the_range_that_an_option_may_have(name, limit):
    there = replaced(STIFF, {f"eddies.{name}": limit})
    (cycle,) = cycles_of(changed(STIFF), 1, 4)
    (balance, *_) = MODEL.estimate(cycle, options_for(there))
    (found,) = (p.value for p in balance.parameters if p.name == f"eddies.{name}")
    assert found == pytest.approx(limit, rel=0.052)
    assert 1e-4 <= found <= 1.0


def test_nothing_is_fitted_without_tolerance_or_whole_samples():
    assert fitted(STIFF, STIFF, np.zeros(4)) is None
    assert fitted(STIFF, STIFF, bad=range(0, 3600, 400)) is None


@pytest.mark.no_cover
def test_a_valve_whose_eddy_currents_differ_by_their_tolerance_is_followed():
    there = changed(STIFF)
    first, second = cycles_of(there, 2, 5)
    told, memory = estimate_cycle(MODEL, options_for(STIFF), first, Memory.empty())
    assert told[0].status is EstimateStatus.ACCEPTED
    (balance, *_) = MODEL.estimate(first, options_for(STIFF))
    for p in balance.parameters:
        truth = getattr(there.eddies, p.name[7:]) if "." in p.name else getattr(there, p.name)
        assert p.lower_95 <= truth <= p.upper_95, p
    (done, *_), _ = estimate_cycle(MODEL, options_for(STIFF), second, memory)
    assert done.fit_test > 97.0


def test_branches_without_tolerance_are_not_told():
    (cycle,) = cycles_of(STIFF, 1, 5)
    options = options_for(STIFF)
    of = replace(options.tolerances.eddies, **dict.fromkeys(BRANCHES, 0.0))
    options = replace(options, tolerances=replace(options.tolerances, eddies=of))
    (balance, *_) = MODEL.estimate(cycle, options)
    assert not [p.name for p in balance.parameters if p.name.startswith("eddies.")]
