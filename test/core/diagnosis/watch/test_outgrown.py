# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A great fault behind a small one that lasts is told."""

from functools import partial

import numpy as np
import pytest

from valve_twin.core.diagnosis.config import OF_ANY_VALVE
from valve_twin.core.diagnosis.detection import detect
from valve_twin.core.diagnosis.generic.signatures import signatures_of
from valve_twin.core.diagnosis.watch.outgrown import outgrown
from valve_twin.core.valves.registry import get_model

SMALL, GREAT = 50, 70


@pytest.fixture(scope="module")
def table():
    found = signatures_of(get_model("first_order"))
    assert found is not None
    return found


def record(table, *, seed=1, n=100, small=SMALL, great=GREAT, slope=0.0):
    """Features of cycles: an offset from `small` on, a slower motion beside it from `great` on."""
    rng = np.random.default_rng(seed)
    least = table.least()
    rows = least * rng.standard_normal((n, len(table.features)))
    cycles = np.arange(1, n + 1)
    for fault, since, far in (("sensor_offset", small, 6.0), ("slow", great, 300.0)):
        change = np.array(next(s.change for s in table.signatures if s.fault == fault))
        rows[cycles >= since] += far / np.linalg.norm(change / least) * change
    rows += slope * least * np.maximum(cycles - small, 0)[:, None]
    return cycles, rows


def told(table, cycles, rows, searched=None):
    searched = searched or partial(detect, restarts=())
    given = cycles, rows, table, OF_ANY_VALVE
    found = searched(*given)
    return found, outgrown(found, *given, searched)


@pytest.mark.parametrize("seed", range(5))
def test_a_far_greater_fault_behind_a_small_one_is_told(table, seed):
    """A doubtful offset of three standard deviations hid a motion three times as slow for good."""
    before, found = told(table, *record(table, seed=seed))
    assert before.findings[-1].fault != "slow"
    *_, small, great = found.findings
    assert (great.fault, great.onset, great.end) == ("slow", GREAT, -1)
    assert small.onset == pytest.approx(SMALL, abs=2)
    assert small.end == GREAT
    assert found.present is great


@pytest.mark.parametrize("seed", range(5))
def test_a_fault_that_lasts_and_one_that_is_over_stay_as_they_are(table, seed):
    for given in ({"great": 1000}, {"small": 1000, "great": GREAT}):
        before, found = told(table, *record(table, seed=seed, **given))
        assert before.findings
        assert found is before


def test_one_that_no_further_cycle_shows_is_none(table):
    cycles, rows = record(table, great=1000)
    rows[GREAT - 1] += 300.0 * table.least()
    before, found = told(table, cycles, rows)
    assert found is before


def test_wear_beside_a_fault_that_lasts_is_no_other_one(table):
    before, found = told(table, *record(table, great=1000, n=400, slope=0.5))
    assert before.findings
    assert found is before
