# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""One cycle alone is a fault only where the valve's own past could not give it."""

import numpy as np
import pytest

from valve_twin.core.diagnosis.changes.alone import departs
from valve_twin.core.diagnosis.config import OF_ANY_VALVE, DetectionConfig
from valve_twin.core.diagnosis.detection import detect
from valve_twin.core.diagnosis.generic.signatures import signatures_of
from valve_twin.core.diagnosis.table import FACTORS, Signature, with_floor
from valve_twin.core.diagnosis.watch.whitened import Whitened
from valve_twin.core.valves.press_cartridge import MODEL
from valve_twin.core.valves.registry import get_model

ONSET = 60


@pytest.fixture(scope="module")
def generic():
    return signatures_of(get_model("first_order"))


def healthy(table, cycles, seed, freedom=0):
    """Return (cycles, F) features that scatter as the table says, with tails of Student's t."""
    covariance = with_floor(np.array(table.covariance), np.array(table.floor))
    rng = np.random.default_rng([17, seed])
    noise = rng.standard_normal((cycles, len(covariance)))
    if freedom:
        noise *= np.sqrt((freedom - 2) / rng.chisquare(freedom, (cycles, 1)))
    level = np.array([dict(table.levels).get(name, 0.0) for name in table.features])
    return level + noise @ np.linalg.cholesky(covariance).T


def searched(table, vectors, config=OF_ANY_VALVE):
    return detect(np.arange(1, len(vectors) + 1), vectors, table, config)


def large(table):
    """Return the signatures of large faults: the third size of each."""
    sizes: dict[tuple[str, bool], list[Signature]] = {}
    for s in table.signatures:
        sizes.setdefault((s.fault, s.severity > 0.0), []).append(s)
    found = [same[len(FACTORS) - 1] for same in sizes.values()]
    return [s for s in found if np.any(s.change)]


@pytest.mark.no_cover
def test_large_faults_are_named_in_their_first_cycle(generic):
    told, without = [], []
    for seed, signature in enumerate(large(generic)[::3]):
        vectors = healthy(generic, ONSET + 1, seed)
        vectors[ONSET] += np.array(signature.change)
        told.append(searched(generic, vectors).present is not None)
        usual = searched(generic, vectors, DetectionConfig())
        without.append(usual.present is not None)
    assert all(told)
    assert np.mean(without) <= 0.2  # where a cycle before strayed by chance


@pytest.mark.parametrize("freedom", [0, 4])
def test_healthy_cycles_raise_no_alarm_by_themselves(generic, freedom):
    added = 0
    for seed in range(2):
        vectors = healthy(generic, 150, 100 + seed, freedom)
        usual = searched(generic, vectors, DetectionConfig()).findings
        added += len(searched(generic, vectors).findings) - len(usual)
    assert added == 0


def test_a_wild_cycle_keeps_its_name_and_is_over_when_the_next_are_as_before(generic):
    vectors = healthy(generic, ONSET + 12, 3)
    signature = large(generic)[0]
    vectors[ONSET] += np.array(signature.change)
    known = [searched(generic, vectors[: ONSET + n]).findings for n in (1, 3, 12)]
    assert [[f.alarm for f in found] for found in known] == [[ONSET + 1]] * 3
    assert {f.fault for found in known for f in found} == {signature.fault}
    assert known[-1][0].end >= 0


def newest_departs(table, vectors, config):
    known = min(config.learn, len(vectors) - config.recent)
    seen = Whitened(vectors, known, table, config)
    return departs(seen.view[0], seen.past, seen.rays, config) > 0.0


@pytest.mark.parametrize("fault", ["leak", "coil_resistance", "sensor_offset"])
def test_the_first_cycle_of_a_medium_fault_departs(fault):
    table, config = MODEL.signatures(), DetectionConfig()
    medium = [s for s in table.signatures if s.fault == fault][1]
    found = 0
    for seed in range(20):
        vectors = healthy(table, ONSET + 1, 200 + seed)
        vectors[ONSET] += np.array(medium.change)
        found += newest_departs(table, vectors, config)
    assert found >= 18
    assert searched(table, vectors, config).departs > 4.0


def test_healthy_cycles_do_not_depart():
    table = MODEL.signatures()
    config = DetectionConfig()
    departing = 0
    for seed in range(4):
        vectors = healthy(table, 150, 300 + seed)
        departing += sum(newest_departs(table, vectors[:n], config) for n in range(30, 151))
    assert departing <= 4  # 0.8 % of 484


def test_a_valve_that_is_told_one_cycle_alone_waits_for_none(generic):
    vectors = healthy(generic, ONSET + 1, 0)
    vectors[ONSET] += np.array(large(generic)[0].change)
    assert searched(generic, vectors).departs == 0.0
