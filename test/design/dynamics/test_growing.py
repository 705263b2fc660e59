# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Growing branches: those of a simulated valve are found again from its currents and force."""

from __future__ import annotations

import numpy as np
import pytest

from test.design.dynamics.made import CURVES, MUTUAL, OWN
from valve_twin.core.prediction import fit_percent
from valve_twin.core.valves.double_solenoid.eddies import EddyConfig, driving, step_branches
from valve_twin.design.dynamics import fit_growing
from valve_twin.design.dynamics.growing import force_with
from valve_twin.design.field import Transient

NUMBERS = (0.008, 5e-4, 0.02, 1e-2, 1.5)
STEP, PARTS = 1e-4, 40


def record(shape, numbers=NUMBERS):
    """Return what the plant's own law makes of voltages, which move two coils in the middle."""
    of, inverse = EddyConfig(*numbers).numbers(), np.linalg.inv([[OWN, MUTUAL], [MUTUAL, OWN]])
    psi = np.array([[OWN, MUTUAL], [MUTUAL, OWN]]) @ [0.5, 0.5]
    eddy, rows = [(0.0, 0.0), (0.0, 0.0)], []
    for n in range(201):
        magnetises = inverse @ psi
        rows.append((magnetises, magnetises + [sum(e) for e in eddy]))
        for part in range(PARTS):
            volts = shape(STEP * (n + part / PARTS))
            at = inverse @ psi
            eddy = [
                step_branches(of, *e, driving(of, i, v), STEP / PARTS)
                for e, i, v in zip(eddy, at, volts, strict=True)
            ]
            psi = psi + volts * STEP / PARTS
    magnetises, drawn = (np.array(of, dtype=np.float64) for of in zip(*rows, strict=True))
    none = np.zeros(len(drawn))
    force = CURVES.force(magnetises, none)
    return Transient(
        STEP * np.arange(201, dtype=np.float64), drawn, none, drawn, force, none, none
    )


def small(time):
    return np.array([4.0, -4.0]) * np.cos(700.0 * time)


def large(time):
    return np.array([10.0, -1.5]) * (np.cos(300.0 * time) if time < np.pi / 300.0 else 0.0)


@pytest.fixture(scope="module")
def records():
    return [record(small), record(large)]


def test_known_branches_are_found_again(records):
    found = fit_growing(records, CURVES)
    assert found.numbers() == pytest.approx(NUMBERS, rel=0.03)
    assert found.force > 99.5
    assert found.without < 90.0


def test_branches_of_one_gain_do_not_show_both(records):
    constant = (0.014, 5e-4, 0.035, 1e-2)  # as grown at rest, 0.5 A
    fits = [fit_percent(of.force, force_with(constant, CURVES, of)) for of in records]
    grown = [fit_percent(of.force, force_with(NUMBERS, CURVES, of)) for of in records]
    assert min(grown) > 99.5
    assert fits[1] < grown[1] - 3.0


def test_a_record_without_eddy_currents_is_refused():
    still = record(large, (1e-9, 5e-4, 0.0, 1e-2, 0.0))
    early = Transient(
        still.time_s, still.currents, still.position, still.flux,
        CURVES.force(1.1 * still.currents, still.position), still.energy, still.joule,
    )  # fmt: skip
    with pytest.raises(ValueError, match=r"eddy currents: the force of the steps fits"):
        fit_growing([early], CURVES)
