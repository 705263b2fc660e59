# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Paper 000: what can be recomputed agrees, what cannot says why."""

from __future__ import annotations

import pytest

from valve_twin.core.valves.double_solenoid.step_response import STEPS
from valve_twin.validation import Verdict, get_paper


@pytest.fixture(scope="module")
def checks():
    advanced: list[int] = []
    paper = get_paper("000")
    found = paper.recompute(lambda: advanced.append(1))
    assert len(advanced) == paper.steps
    return {c.quantity: c for c in found}


def test_nothing_that_can_be_recomputed_fails(checks):
    assert [c.quantity for c in checks.values() if c.verdict is Verdict.FAIL] == []
    assert sum(c.verdict is Verdict.PASS for c in checks.values()) == 23


def test_what_cannot_be_reproduced_says_why(checks):
    missing = [c for c in checks.values() if c.verdict is Verdict.CANNOT]
    assert len(missing) == 6
    assert all(c.note for c in missing)


def test_the_flux_is_met_within_its_published_kind(checks):
    """equations.md, section 6, 000-flux: U t_s = 0.30 mWb."""
    assert checks["flux error, flank of 1.2 ms [mWb]"].obtained <= 0.30
    assert checks["flux error after the slope was reduced [mWb]"].obtained <= 0.30


@pytest.mark.parametrize("share", STEPS)
def test_steps_of_both_controllers_show_rise_and_overshoot(checks, share):
    for name in ("MPTSC", "nonlinear PID"):
        of = checks[f"{name}: {100.0 * share:g} % step settled [ms]"]
        assert of.obtained < 40.0
        assert "rise" in of.note
        assert "overshoot" in of.note
