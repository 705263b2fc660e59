# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Checks that half of the newest estimates fail are told, behind the evidence of the verdict."""

import pytest

from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.aging.verdict import VerdictKind
from valve_twin.core.diagnosis.checks import failed_checks
from valve_twin.core.types import Estimate, EstimateStatus, Guard, Maintenance, ParameterValue
from valve_twin.core.valves.press_cartridge import MODEL


def given(cycle, name="bounds", *, passed=True, status=EstimateStatus.ACCEPTED):
    return Estimate(
        model=MODEL.name,
        estimator="output_error",
        cycle=cycle,
        start_ns=cycle * 10**10,
        end_ns=cycle * 10**10 + 1,
        parameters=tuple(
            ParameterValue(p.name, 1.0 + 1e-3 * (cycle % 5)) for p in MODEL.parameters
        ),
        status=status,
        reason="",
        used_by_trend=True,
        guards=(Guard(name, passed, 1.0, 0.0, f"leak at its bound in cycle {cycle}"),),
    )


def history(failing, name="bounds"):
    """Return 30 cycles of which those named fail a check."""
    return [given(c, name, passed=c not in failing) for c in range(1, 31)]


def test_a_check_that_half_of_the_newest_cycles_fail_reaches_the_verdict():
    estimates = history(range(21, 31))
    told = "check of bounds failed in 10 of the newest 20 cycles: leak at its bound in cycle 30"
    assert failed_checks(estimates) == told
    verdict = assess(estimates, (), AgingConfig(), parameters=MODEL.parameters).verdict
    assert verdict.kind is VerdictKind.OK
    assert verdict.evidence.endswith(told)


@pytest.mark.parametrize("failing", [range(22, 31), range(1, 11)])
def test_fewer_or_older_failures_are_not_told(failing):
    assert failed_checks(history(failing)) == ""


def test_a_check_that_only_informs_is_not_told():
    assert failed_checks(history(range(1, 31), "equation-error gap of pole")) == ""


def test_a_drifted_dimension_is_told_until_maintenance_renews_the_reference():
    estimates = history(range(11, 26), "dimension: gap_b")
    told = failed_checks(estimates)
    assert told.startswith("check of dimension: gap_b failed in 15 of the newest 20 cycles")
    assert failed_checks(estimates, 26) == ""
    for renewed in (False, True):
        events = (Maintenance(0, 26, "new pole", new_reference=renewed),)
        evidence = assess(estimates, events, AgingConfig(), parameters=MODEL.parameters).verdict
        assert ("dimension: gap_b" in evidence.evidence) is not renewed


def test_refused_cycles_and_four_cycles_say_nothing():
    refused = [given(c, passed=False, status=EstimateStatus.REFUSED) for c in range(1, 31)]
    assert failed_checks(refused) == ""
    assert failed_checks(history(range(1, 31))[:4]) == ""
    assert failed_checks(history(range(1, 31))[:5])
