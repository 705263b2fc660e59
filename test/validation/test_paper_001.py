# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Paper 001: what can be recomputed agrees, what cannot says why."""

from __future__ import annotations

import pytest

from valve_twin.validation import Verdict
from valve_twin.validation.paper_001 import pulse, throw


@pytest.fixture(scope="module")
def checks(recomputed):
    return {c.quantity: c for c in recomputed("001")}


def test_nothing_that_can_be_recomputed_fails(checks):
    assert [c.quantity for c in checks.values() if c.verdict is Verdict.FAIL] == []
    assert sum(c.verdict is Verdict.PASS for c in checks.values()) == 20


def test_what_cannot_be_reproduced_says_why(checks):
    missing = [c for c in checks.values() if c.verdict is Verdict.CANNOT]
    assert len(missing) == 12
    assert all(c.note for c in missing)


def test_the_design_equations_agree_with_their_own_numbers(checks):
    assert checks["flux of the core [Wb]"].obtained == pytest.approx(30.067e-5, rel=2e-5)
    assert checks["m.m.f. of a gap of 4 mm [A]"].obtained == pytest.approx(8740.37, rel=1e-6)
    force = checks["holding force [N]"]
    assert force.verdict is Verdict.CANNOT
    assert force.obtained == pytest.approx(750.0, rel=1e-3)


def test_the_mass_follows_from_the_printed_formula(checks):
    assert checks["moving mass of the simulated valve [kg]"].obtained == pytest.approx(
        0.12983, rel=1e-4
    )


def test_the_regular_reading_is_kept_as_a_value():
    assert pulse("saturating", 24.0)[1] == pytest.approx(718.8, rel=1e-3)
    assert pulse("saturating", 12.0)[1] == pytest.approx(169.6, rel=1e-3)


def test_the_two_kernels_throw_equally_far():
    assert throw("saturating_fit")[0] - throw("linear")[0] == pytest.approx(18e-6, abs=3e-6)
