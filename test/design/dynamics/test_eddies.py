# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Branches of eddy currents: known ones are found again, none are refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from test.design.dynamics.made import CURVES, GAINS, TIMES, answer
from valve_twin.design.dynamics import branch_records, eddies, fit_branches
from valve_twin.design.dynamics.eddies import magnetising

NO_MESH: Any = None


@pytest.fixture(scope="module")
def records():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(eddies, "run_transient", answer)
        return branch_records(NO_MESH, 2e-4)


def test_known_branches_are_found_again(records):
    found = fit_branches(records, CURVES)
    assert found.gains == pytest.approx(GAINS, rel=0.03)
    assert found.times == pytest.approx(TIMES, rel=0.05)
    assert found.fit > 99.0 > found.without
    assert found.force > 99.9  # the force is that of the currents that magnetise
    assert found.numbers() == (
        found.gains[0], found.times[0], found.gains[1], found.times[1]
    )  # fmt: skip


def test_both_coils_and_both_biases_are_excited(records):
    together, against = records
    assert np.ptp(together.currents[:, 1]) == 0.0
    assert against.currents.sum(axis=1) == pytest.approx(np.ones(len(against.time_s)))


def test_the_currents_that_magnetise_are_those_of_the_flux():
    i = np.array([[1.0, 0.2], [0.3, 2.0]])
    x = np.array([0.5e-3, -0.5e-3])
    found = magnetising(CURVES, CURVES.flux(i, x), np.ones((2, 2)), x)
    assert found == pytest.approx(i, abs=2e-2)  # what four passes leave of a coupling of a fifth


def test_a_record_without_eddy_currents_is_refused():
    time_s = np.linspace(0.0, 0.02, 101)
    currents = np.column_stack([1.0 + 0.8 * np.sin(300.0 * time_s), np.ones(101)])
    early = answer(None, time_s, currents, gains=(-1e-4, -1e-4))
    with pytest.raises(ValueError, match=r"must be above 0: see steel\.conductivity"):
        fit_branches([early], CURVES)
