# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Strokes between two limit switches, from made cycles."""

import numpy as np
import pytest

from valve_twin.core.types import Cycle, Frames
from valve_twin.core.valves.cycle_timing import MODEL
from valve_twin.core.valves.cycle_timing.strokes import find_strokes
from valve_twin.core.valves.registry import complete_options

PERIOD_S = 0.1
OPTIONS = complete_options(
    MODEL, {"between_ends": True, "steady_start_s": 2.0, "steady_end_s": 4.0, "spike_start_s": 0.0}
)


def cycle(*runs, gaps=()):
    """Return 8 s of a valve that is between its switches in `runs` (from, to) [s]."""
    t = PERIOD_S * np.arange(80)
    between = np.zeros(80)
    for begin, end in runs:
        between[(t >= begin - 1e-9) & (t < end - 1e-9)] = 1.0
    between[list(gaps)] = np.nan
    nothing, valid = np.full(80, np.nan), np.ones(80, dtype=bool)
    stamps = np.round(1e9 * t).astype(np.int64)
    return Cycle(1, PERIOD_S, Frames(stamps, between, np.empty((80, 0)), nothing, nothing, valid))


@pytest.mark.parametrize(
    ("runs", "opened", "closed", "close_time"),
    [
        (((0.2, 1.0), (5.0, 6.5)), 1.0, 1.0, 1.5),
        (((0.2, 1.0), (4.6, 4.7), (5.0, 6.5)), 1.0, 1.0, 1.5),  # the switch bounces
        (((0.2, 2.5), (5.0, 6.5)), 1.0, 1.0, 1.5),  # slow, but it arrives
        ((), 0.0, np.nan, np.nan),  # it stays at one end
        (((0.2, 6.0),), 0.0, np.nan, np.nan),  # back without having arrived
        (((0.2, 8.0),), 0.0, 0.0, np.nan),  # between both for good
        (((0.2, 1.0),), 1.0, 0.0, np.nan),  # it stays open
        (((0.2, 1.0), (5.0, 8.0)), 1.0, 0.0, np.nan),  # it closes too slowly
    ],
)
def test_ends_and_the_time_back_are_those_of_the_cycle(runs, opened, closed, close_time):
    found = find_strokes(cycle(*runs), OPTIONS)
    told = (found.opened, found.closed, found.close_time)
    assert told == pytest.approx((opened, closed, close_time), nan_ok=True)


def test_a_cycle_that_is_not_whole_tells_nothing():
    found = find_strokes(cycle((0.2, 1.0), (5.0, 6.5), gaps=(30,)), OPTIONS)
    assert np.isnan([found.opened, found.closed, found.close_time]).all()


def test_they_are_published_where_they_are_asked_for_alone():
    shown = cycle((0.2, 1.0), (5.0, 6.5))
    (found,) = MODEL.estimate(shown, OPTIONS)
    assert [found.value(n) for n in ("close_time", "opened", "closed")] == pytest.approx(
        [1.5, 1.0, 1.0]
    )
    (flow,) = MODEL.estimate(shown, complete_options(MODEL, {}))
    assert "opened" not in {p.name for p in flow.parameters}
    assert MODEL.also_followed(OPTIONS) == ("rise_instant", "decay", "close_time")
    assert MODEL.also_followed(complete_options(MODEL, {})) == ()
