# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Valves that do not open or close on demand, by histories of what limit switches say."""

import numpy as np
import pytest

from valve_twin.core.diagnosis.direct.unreached import CLOSED, OPENED, unreached
from valve_twin.core.types import Estimate, EstimateStatus, ParameterStatus, ParameterValue

BOTH, SHORT, STAYS, OPEN = (1.0, 1.0), (0.0, np.nan), (0.0, np.nan), (1.0, 0.0)


def history(*ends):
    """Return the estimates of cycles that reached (open, closed) ends."""
    return [
        Estimate(
            model="cycle_timing",
            estimator="centroid",
            cycle=n,
            start_ns=n * 10**9,
            end_ns=n * 10**9 + 5 * 10**8,
            parameters=tuple(
                ParameterValue(name, value)
                if np.isfinite(value)
                else ParameterValue(name, value, ParameterStatus.REFUSED, "not shown")
                for name, value in zip((OPENED, CLOSED), reached, strict=True)
            ),
            status=EstimateStatus.PARTIAL,
            reason="",
            used_by_trend=True,
        )
        for n, reached in enumerate(ends, 1)
    ]


@pytest.mark.parametrize(
    ("misses", "fault"),
    [((SHORT, SHORT), "no_opening"), ((OPEN, STAYS, STAYS), "no_closing")],
)
def test_two_cycles_in_a_row_that_miss_an_end_name_it(misses, fault):
    found = unreached(history(*10 * [BOTH], *misses))
    assert found is not None
    assert (found.fault, found.part, found.onset, found.alarm) == (fault, "valve", 11, 12)
    assert unreached(history(*10 * [BOTH], misses[0])) is None
    assert unreached(history(*10 * [BOTH], *misses, BOTH)) is None  # it is over


def test_a_valve_that_is_stroked_in_part_or_has_no_past_misses_nothing():
    assert unreached(history(*10 * [BOTH, SHORT], SHORT, SHORT)) is None
    assert unreached(history(*4 * [BOTH], SHORT, SHORT)) is None
    assert unreached(history(*6 * [SHORT])) is None
    assert unreached([]) is None


def test_a_cycle_that_tells_nothing_is_no_miss():
    unseen = (np.nan, np.nan)
    assert unreached(history(*10 * [BOTH], unseen, unseen)) is None
    found = unreached(history(*10 * [BOTH], SHORT, unseen, SHORT))
    assert found is not None
    assert (found.onset, found.alarm) == (11, 13)


def test_maintenance_ends_what_was_missed_before_it():
    """A jammed spindle was freed and marked: the name stayed until the next whole stroke."""
    given = history(*10 * [BOTH], SHORT, SHORT)
    assert unreached(given, since=12) is None  # one miss since
    assert unreached(given, since=13) is None
    assert str(unreached(given, since=11)) == str(unreached(given)) != "None"
    again = history(*10 * [BOTH], SHORT, SHORT, SHORT, SHORT)
    found = unreached(again, since=13)
    assert found is not None
    assert (found.fault, found.onset, found.alarm) == ("no_opening", 13, 14)
