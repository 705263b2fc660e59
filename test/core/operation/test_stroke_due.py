# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Days since and until a stroke test, from the event log."""

import math

import pytest

from valve_twin.core.operation.events import Event
from valve_twin.core.operation.stroke_due import StrokeDue, stroke_due, stroke_event
from valve_twin.core.operation.stroke_test import Criterion, StrokeTest, StrokeVerdict

DAY_NS = 86_400 * 10**9
PASSED = StrokeTest(StrokeVerdict.PASS, (Criterion("t63_s", 2.0, 5.0),), 0.2, 1e-4)
FAILED = StrokeTest(StrokeVerdict.FAIL, (Criterion("travel", 0.95, 0.05),), 0.2, 1e-4)


def test_the_entry_says_what_was_not_kept():
    good, bad = stroke_event(7, PASSED), stroke_event(8, FAILED)
    assert (good.code, good.status, good.is_open) == ("stroke_test.pass", "good", False)
    assert (bad.code, bad.status, bad.is_open) == ("stroke_test.fail", "failure", True)
    assert bad.text == "a stroke of 0.2 was tested: fail, not kept: travel 0.95 of 0.05"


@pytest.mark.parametrize(
    ("days", "interval", "words"),
    [
        (12.25, 30.0, "12.2 days ago, next in 17.8 days"),
        (40.0, 30.0, "40.0 days ago, overdue by 10.0 days"),
        (40.0, 0.0, "40.0 days ago"),
        (-1.0, 30.0, "0.0 days ago, next in 30.0 days"),
    ],
)
def test_days_count_from_the_last_test_to_the_last_cycle(days, interval, words):
    last = 1000 * DAY_NS
    events = [
        stroke_event(last, FAILED), Event(last + 5, 3, "fault.leak", "failure", ""),
        stroke_event(last - 9 * DAY_NS, PASSED),
    ]  # fmt: skip
    due = stroke_due(events, last + round(days * DAY_NS), interval)
    assert (due.stamp_ns, due.verdict, due.words) == (last, "fail", words)


def test_without_a_test_nothing_is_known():
    due = stroke_due([Event(5, 3, "fault.leak", "failure", "")], DAY_NS, 30.0)
    assert due.words == ""
    assert math.isnan(due.until_days)
    assert due.verdict == StrokeDue().verdict == ""
