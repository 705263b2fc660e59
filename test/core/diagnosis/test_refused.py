# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Cycles without an estimate withdraw what was said, and one that does not end names its cause."""

from dataclasses import replace

import pytest

from valve_twin.core.aging import AgingConfig, VerdictKind, assess
from valve_twin.core.diagnosis.refused import LEAST_REFUSED, overdue, refused_lately
from valve_twin.core.refusal import RefusalCode
from valve_twin.core.types import Estimate, EstimateStatus, ParameterValue
from valve_twin.core.valves.press_cartridge import MODEL

CYCLE_NS = 10**10


def given(cycle, *, status=EstimateStatus.ACCEPTED, code="", reason="", length=1.0):
    """Return the estimate of a cycle of `length` usual lengths."""
    start = cycle * CYCLE_NS
    return Estimate(
        model=MODEL.name,
        estimator="output_error",
        cycle=cycle,
        start_ns=start,
        end_ns=start + round(0.9 * length * CYCLE_NS),
        parameters=tuple(
            ParameterValue(p.name, 1.0 + 1e-3 * (cycle % 5)) for p in MODEL.parameters
        ),
        status=status,
        reason=reason,
        reason_code=code,
        used_by_trend=True,
    )


def refused(cycle, code, **options):
    return given(cycle, status=EstimateStatus.REFUSED, code=code, reason="why", **options)


USUAL = [given(c) for c in range(1, 21)]


def verdict(history):
    return assess(history, (), AgingConfig(), parameters=MODEL.parameters).verdict


def test_ok_is_withdrawn_after_the_fifth_refused_cycle_and_comes_back():
    bad = [refused(c, RefusalCode.IMPLAUSIBLE.value) for c in range(21, 21 + LEAST_REFUSED)]
    assert verdict(USUAL).kind is VerdictKind.OK
    assert verdict(USUAL + bad[:-1]).kind is VerdictKind.OK
    said = verdict(USUAL + bad)
    assert said.kind is VerdictKind.NOT_ENOUGH_DATA
    assert said.evidence == "the newest 5 cycles gave no estimate: why"
    assert verdict([*USUAL, *bad, given(26)]).kind is VerdictKind.OK


def test_what_does_not_feed_the_trend_says_nothing():
    others = [replace(refused(c, "other"), used_by_trend=False) for c in range(21, 31)]
    assert not refused_lately(USUAL + others)


def test_a_cycle_that_does_not_end_and_does_not_move_is_no_motion_until_one_moves():
    stuck = refused(21, RefusalCode.NO_MOTION.value, length=3.0)
    found = overdue([*USUAL, stuck])
    assert found is not None
    assert (found.fault, found.part, found.onset, found.end) == ("no_motion", "valve", 21, -1)
    assert overdue([*USUAL, stuck, given(25)]) is None


@pytest.mark.parametrize(
    "last",
    [
        refused(21, RefusalCode.NO_MOTION.value),
        refused(21, RefusalCode.MISFIT.value, length=3.0),
        given(21, length=3.0),
    ],
)
def test_a_cycle_of_usual_length_or_with_motion_is_not(last):
    assert overdue([*USUAL, last]) is None


def test_a_first_cycle_that_does_not_end_has_no_usual_length():
    assert overdue([*USUAL[:4], refused(5, RefusalCode.NO_MOTION.value, length=9.0)]) is None
