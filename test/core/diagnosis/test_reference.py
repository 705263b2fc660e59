# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A valve's own past is a reference once it is long and its first cycles are like those since."""

import numpy as np
import pytest

from valve_twin.core.diagnosis.config import DetectionConfig
from valve_twin.core.diagnosis.reference import doubt_of
from valve_twin.core.valves.press_cartridge import MODEL

TABLE = MODEL.signatures()
SETTLED = DetectionConfig().settled


def healthy(cycles, seed):
    """Return features that scatter as those of the table about a slow drift."""
    rng = np.random.default_rng(seed)
    scatter = rng.multivariate_normal(np.zeros(len(TABLE.features)), TABLE.covariance, cycles)
    aging = np.sqrt(np.diag(TABLE.covariance)) * np.linspace(0.0, 3.0, cycles)[:, None]
    return scatter + aging


def doubt(vectors):
    return doubt_of(np.arange(1, len(vectors) + 1), vectors, TABLE)


def test_few_cycles_are_no_reference():
    vectors = healthy(SETTLED, 1)
    told = doubt(vectors[:-1])
    assert told.startswith(f"no reference yet: {SETTLED - 1} of {SETTLED} cycles")
    assert doubt(vectors) == ""


def test_a_steady_past_is_one_in_all_but_few_of_200_histories():
    assert sum(bool(doubt(healthy(60, seed))) for seed in range(200)) <= 2


@pytest.mark.parametrize("name", ["leak", "supply_drop", "sensor_offset"])
def test_a_fault_that_began_in_the_first_cycles_leaves_none(name):
    change = np.array(next(s.change for s in reversed(TABLE.signatures) if s.fault == name))
    found = 0
    for seed in range(20):
        vectors = healthy(60, seed)
        vectors[4:] += change
        told = doubt(vectors)
        found += told.startswith("no reference: cycles 1 to 4 differ")
        assert doubt(vectors[:30]) in ("", told)  # what is found once is found in longer ones
    assert found >= 18


def test_a_fault_that_began_later_is_no_doubt_about_the_first_cycles():
    change = np.array(next(s.change for s in reversed(TABLE.signatures) if s.fault == "leak"))
    vectors = healthy(60, 3)
    vectors[40:] += change
    assert doubt(vectors) == ""
