# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The end of a fault of the first cycles is no new change, and an old line ends none."""

import numpy as np
import pytest

from valve_twin.core.diagnosis.changes.ends import first_alike, first_unlike, healed, jumped_back
from valve_twin.core.diagnosis.config import DetectionConfig
from valve_twin.core.diagnosis.detection import detect
from valve_twin.core.diagnosis.watch.straight import lines_through
from valve_twin.core.valves.press_cartridge import MODEL

FEATURES = 13
ONSET = 14


def steps(*edges, seed=1, size=10.0):
    """Return 24 whitened cycles that are off by `size` between the edges."""
    w = np.random.default_rng(seed).standard_normal((24, FEATURES))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        w[first:last, 3] += size
    return w


@pytest.mark.parametrize("seed", range(20))
def test_the_end_of_a_fault_is_where_the_first_cycles_come_back(seed):
    assert first_alike(steps(6, ONSET, seed=seed), ONSET) == 6


@pytest.mark.parametrize("seed", range(20))
def test_a_change_behind_cycles_that_were_all_alike_is_none(seed):
    assert first_alike(steps(ONSET, 24, seed=seed), ONSET) == 0
    assert first_unlike(steps(ONSET, 24, seed=seed), ONSET) == 0


def test_a_change_to_somewhere_else_is_no_end():
    w = steps(6, ONSET)
    w[ONSET:, 5] += 10.0
    assert first_alike(w, ONSET) == 0


def test_what_only_the_first_cycles_had_is_no_change_of_later_ones():
    assert first_unlike(steps(0, 5), ONSET) == 5


def test_a_lasting_fault_is_not_over_since_a_line_of_few_cycles_leads_to_it():
    config = DetectionConfig()
    w = np.zeros((60, FEATURES))
    w[:12, 0] = 0.25 * np.arange(12)  # a slope by chance
    w[12:, 0] = 8.0
    ray = np.eye(FEATURES)[0]
    assert healed(w, ray, lines_through(w, np.array([11]), config.window), config, 13) == -1
    w[40:, 0] = 1.4
    assert healed(w, ray, lines_through(w, np.array([11]), config.window), config, 13) == 44


def test_a_dead_band_of_the_seventh_to_the_sixteenth_cycle_is_over_behind_it():
    table = MODEL.signatures()
    change = 6.0 * np.array(
        next(s.change for s in reversed(table.signatures) if s.fault == "dead_band")
    )
    alarms = 0
    for seed in (17, 19, 34, 63):  # where the line is bent so that the end is a change
        rng = np.random.default_rng(seed)
        rows = rng.multivariate_normal(np.zeros(len(table.features)), table.covariance, 24)
        rows[6:16] += change
        alarms += detect(np.arange(1, 25), rows, table).present is not None
    assert alarms == 0


def aging_with(first, last, *, size, seed, between=1.0):
    """Return 60 whitened cycles that age, off by `size` between two rows."""
    rng = np.random.default_rng([8, seed])
    w = rng.standard_normal((60, FEATURES)) + np.linspace(0.0, 12.0, 60)[:, None]
    w[first:last, :4] += 0.5 * size * rng.uniform(between, 1.0, (last - first, 1))
    return w


@pytest.mark.parametrize("size", [-10.0, 30.0])
def test_a_fault_is_over_where_the_valve_jumps_back_though_it_has_aged(size):
    config = DetectionConfig()
    ends = []
    for seed in range(20):
        w = aging_with(18, 26, size=size, seed=seed)
        before = lines_through(w, np.array([17]), config.window)
        ray = np.sign(size) * np.eye(FEATURES)[:4].sum(axis=0) / 2.0
        assert healed(w[:40], ray, before, config, 19) == -1  # not where it began
        ends.append(jumped_back(w, 18, 19, config))
    assert sum(end in {30, 31} for end in ends) >= 19


@pytest.mark.parametrize("between", [1.0, 0.0])
def test_a_lasting_fault_is_not_over_also_where_it_comes_and_goes(between):
    config = DetectionConfig()
    for seed in range(40):
        w = aging_with(18, 60, size=12.0, seed=seed, between=between)
        assert jumped_back(w, 18, 19, config) == -1


def test_another_fault_behind_a_fault_is_no_end_of_it():
    config = DetectionConfig()
    for seed in range(20):
        w = aging_with(18, 60, size=12.0, seed=seed)
        w[30:, 5:9] -= 8.0
        assert jumped_back(w, 18, 19, config) == -1


def test_one_wild_cycle_within_a_lasting_fault_is_no_end_of_it():
    table = MODEL.signatures()
    change = np.array([s for s in table.signatures if s.fault == "leak"][1].change)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        rows = rng.multivariate_normal(np.zeros(len(change)), table.covariance, 84)
        rows[60:] += change
        rows[75] += 3.0 * change
        (found,) = detect(np.arange(1, len(rows) + 1), rows, table).findings
        assert (found.onset, found.end) == (61, -1)


def test_a_fault_that_ends_beside_aging_is_over_in_a_history():
    table = MODEL.signatures()
    change = np.array([s for s in table.signatures if s.fault == "leak"][2].change)
    aged = np.sqrt(np.diag(table.covariance))
    ends = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        rows = rng.multivariate_normal(np.zeros(len(change)), table.covariance, 60)
        rows += np.linspace(0.0, 20.0, 60)[:, None] * aged
        rows[24:34] += change
        ends += [f.end for f in detect(np.arange(1, 61), rows, table).findings if f.onset == 25]
    assert ends == [39, 39, 39]
