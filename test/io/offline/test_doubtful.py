# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What of a record could be used, and when its results must not be relied on."""

from types import SimpleNamespace
from typing import Any

import pytest

from valve_twin.core.aging.verdict import Verdict, VerdictKind
from valve_twin.core.types import Estimate, EstimateStatus, Guard
from valve_twin.io.offline.doubtful import describe_use, is_doubtful
from valve_twin.io.offline.run import Record

OK, REFUSED = EstimateStatus.ACCEPTED, EstimateStatus.REFUSED


def record(states, *, lost=0, paused=0, passed=True):
    """Return a record of cycles of 100 samples each, by the states of their estimates."""
    estimates = [
        Estimate(
            model="press_cartridge",
            estimator="output_error",
            cycle=k,
            start_ns=k,
            end_ns=k + 1,
            parameters=(),
            status=state,
            reason="",
            used_by_trend=True,
            guards=(Guard("bounds", passed, 1.0, 0.0, "leak at its bound"),),
        )
        for k, state in enumerate(states, 1)
    ]
    cycles: Any = [SimpleNamespace(samples=100, lost=lost) for _ in states]
    return Record(cycles=cycles, estimates=estimates, paused=paused)


NONE, UNUSABLE = VerdictKind.NOT_ENOUGH_DATA, VerdictKind.RECORDING_UNUSABLE


def said(kind=NONE):
    return SimpleNamespace(verdict=Verdict(0, "", kind, kind.text, "", 1))


@pytest.mark.parametrize(
    ("found", "text"),
    [
        (record([OK] * 6), "6 cycles"),
        (record([OK] * 4 + [REFUSED] * 2), "6 cycles, 2 refused"),
        (record([OK] * 2, lost=25), "2 cycles, 50 of 250 samples lost"),
        (
            record([OK] * 2, lost=25, paused=48),
            "2 cycles, 2 of 202 samples lost, 48 more in pauses",
        ),
    ],
)
def test_the_summary_counts_what_was_refused_and_lost(found, text):
    assert describe_use(found) == text


@pytest.mark.parametrize(
    ("found", "kind", "doubtful"),
    [
        (record([OK] * 6), NONE, False),
        (record([OK] * 6), UNUSABLE, True),
        (record([REFUSED] * 6), NONE, True),
        (record([OK] + [REFUSED] * 5), NONE, False),
        (record([OK] * 6, passed=False), NONE, True),
        (record([OK] * 6, lost=5), NONE, False),
        (record([OK] * 6, lost=6), NONE, True),
        (record([OK] * 6, lost=50, paused=300), NONE, False),
        (record([OK] * 6, lost=50, paused=250), NONE, True),
    ],
)
def test_a_record_is_doubtful_for_four_reasons(found, kind, doubtful):
    assert is_doubtful(found, said(kind)) is doubtful
