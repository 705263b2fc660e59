# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is seldom shown confirms nothing between, on a cylinder that sometimes stops half way."""

import numpy as np
import pytest

from valve_twin.core.diagnosis.config import OF_ANY_VALVE
from valve_twin.core.diagnosis.detection import detect
from valve_twin.core.diagnosis.generic.features import Record, cycle_features
from valve_twin.core.diagnosis.generic.signatures import signatures_of
from valve_twin.core.valves.registry import get_model

CYCLES, PERIOD_S = 60, 0.02
NONE = np.zeros((660, 0))
SETTING_UP, SELDOM = 10, 6
"""Cycles of which each second stops half way; then one in so many does."""


LOGARITHMS = ("rest_noise", "move_noise", "rough_rest", "rough_move", "gain_up", "gain_down")
TABLE = signatures_of(get_model("positioner")) or pytest.fail("no signatures")


def stroke(speed, half):
    """Return a cylinder that goes out, after a stop half way, and back; cushioned at both ends."""
    x, out, stop = 0.0, [], 0.0
    for n in range(660):
        way = 1.0 if 20 <= n < 320 else -1.0 if n >= 340 else 0.0
        left = 1.0 - x if way > 0.0 else x
        if way > 0.0 and half and half <= x and stop < 60:
            x, stop = half, stop + 1
        else:
            x += way * PERIOD_S * speed * min(1.0, max(8.0 * left, 0.2))
        x = min(max(x, 0.0), 1.0)
        out.append(x)
    return np.array(out)


def cylinder(odd=None, size=0.0, since=None):
    """Return the features of its cycles; the stop of cycle `odd`, or of all since, is off."""
    random, rows = np.random.default_rng(3), []
    for n in range(CYCLES):
        half = 0.5 if n % (2 if n < SETTING_UP else SELDOM) == 0 else 0.0
        response = stroke(0.5, half)
        late = 1.0 + 0.004 * random.standard_normal()
        measured = stroke(0.5 * late, half) + 2e-4 * random.standard_normal(660)
        level = 4e-4 * random.standard_normal()
        level += size * (n == odd or (since is not None and n >= since))
        measured += np.where(np.abs(response - 0.5) < 0.02, level, 0.0)
        found = cycle_features(Record(measured, response, PERIOD_S, NONE))
        rows.append([np.log(found[f]) if f in LOGARITHMS else found[f] for f in TABLE.features])
    return np.array(rows)


def search(vectors):
    return detect(np.arange(1, len(vectors) + 1), vectors, TABLE, OF_ANY_VALVE).findings


@pytest.mark.parametrize("size", [6e-3, 2e-2])
def test_one_odd_value_of_a_seldom_shown_feature_is_no_fault(size):
    """Carried on to the next cycles that do not show it, it confirmed itself."""
    assert search(cylinder(odd=42, size=size)) == ()


def test_a_change_is_found_where_the_feature_is_shown_again():
    (found,) = search(cylinder(since=42, size=6e-3))
    assert (found.alarm, found.end) == (42 + SELDOM + 1, -1)
