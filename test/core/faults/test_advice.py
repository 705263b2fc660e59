# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a verdict asks of maintenance."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from valve_twin.core.aging.verdict import LimitState, Trend, TrendStatus, Verdict, VerdictKind
from valve_twin.core.diagnosis.table import FAULT_TYPES
from valve_twin.core.faults.advice import (
    FAILURE_MODES,
    FAULT_ADVICE,
    NOW,
    PLAN,
    advise,
    with_advice_table,
)
from valve_twin.core.faults.ne107 import Ne107

DOCUMENT = Path(__file__).parents[3] / "docs" / "diagnosis.md"


def verdict(kind: VerdictKind, fault: str = "") -> Verdict:
    return Verdict(0, "/v", kind, kind.text, "evidence", 12, fault)


def trend(state: LimitState) -> Trend:
    status = TrendStatus.DRIFTING
    if state is LimitState.ALARM:
        status = TrendStatus.BEYOND_THRESHOLD
    known = Trend(0, "/v", "leak", "1/s", "cycles", status, "", 20, 1, 1.0, 20.0)
    return replace(known, limit_state=state)


def test_every_fault_that_is_separated_has_all_of_an_advice():
    assert set(FAULT_ADVICE) == {f.name for f in FAULT_TYPES} | {"unknown"}
    for name, advice in FAULT_ADVICE.items():
        assert advice.ne107 is not Ne107.GOOD, name
        assert advice.failure_mode in FAILURE_MODES, name
        assert all((advice.part, advice.cause, advice.action, advice.urgency)), name
    assert set(FAILURE_MODES) == {a.failure_mode for a in FAULT_ADVICE.values()}


@pytest.mark.parametrize("kind", VerdictKind)
def test_every_verdict_has_a_state(kind):
    advice = advise(verdict(kind))
    assert (advice.ne107 is Ne107.GOOD) == (kind is VerdictKind.OK)
    assert bool(advice.sentence) == (kind is not VerdictKind.OK)
    assert bool(advice.urgency) == kind.asks_for_help


def test_a_sudden_fault_is_asked_for_by_its_name():
    advice = advise(verdict(VerdictKind.VALVE, "no_motion"))
    assert (advice.ne107, advice.failure_mode) == (Ne107.FAILURE, "FTR")
    assert advice.sentence.startswith("spool and its command: stop")
    assert advice.sentence.endswith(", now")


def test_wear_is_planned_until_its_limit_is_passed():
    drifting = verdict(VerdictKind.VALVE, "K_in")
    on_its_way = replace(trend(LimitState.WARNING), parameter="K_in")
    beyond = replace(trend(LimitState.ALARM), parameter="K_in")
    planned, due = advise(drifting, [on_its_way]), advise(drifting, [beyond])
    assert (planned.ne107, planned.urgency) == (Ne107.MAINTENANCE_REQUIRED, PLAN)
    assert (due.ne107, due.urgency) == (Ne107.OUT_OF_SPECIFICATION, NOW)
    assert "K_in" in planned.cause


def test_a_parameter_that_is_called_as_a_fault_is_has_the_failure_mode_of_it():
    worn = advise(verdict(VerdictKind.VALVE, "leak"), [trend(LimitState.ALARM)])
    assert (worn.ne107, worn.failure_mode, worn.urgency) == (
        Ne107.OUT_OF_SPECIFICATION,
        "INL",
        NOW,
    )


def test_the_documented_table_is_that_of_the_code():
    text = DOCUMENT.read_text(encoding="utf-8")
    assert with_advice_table(text) == text, "write it anew: tools/run tools/parameters"
