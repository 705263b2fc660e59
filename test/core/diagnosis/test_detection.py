# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Detection and isolation on features drawn from the table's own scatter: truth is known."""

import numpy as np
import pytest

from valve_twin.core.diagnosis.changes.finding import UNKNOWN
from valve_twin.core.diagnosis.changes.jumps import BEYOND
from valve_twin.core.diagnosis.config import DetectionConfig
from valve_twin.core.diagnosis.detection import detect
from valve_twin.core.diagnosis.isolability import isolability
from valve_twin.core.diagnosis.table import FACTORS, SIZES, whitener, with_floor
from valve_twin.core.diagnosis.watch import alarm

ONSET = 60


def healthy(table, cycles, seed, drift=0.0):
    """Return (cycles, F) features that scatter as the table says and drift on a line."""
    covariance = with_floor(np.array(table.covariance), np.array(table.floor))
    random = np.random.default_rng(seed)
    noise = random.standard_normal((cycles, len(covariance))) @ np.linalg.cholesky(covariance).T
    deviation = np.sqrt(np.diag(covariance))
    direction = random.choice([-1.0, 1.0], len(covariance))
    return noise + drift * np.arange(cycles)[:, None] * direction * deviation


def with_fault(table, vectors, signature, *, start=ONSET, end=None):
    return vectors + np.where(
        ((np.arange(len(vectors)) >= start) & (np.arange(len(vectors)) < (end or 10**9)))[:, None],
        np.array(signature.change),
        0.0,
    )


def search(table, vectors, **options):
    return detect(np.arange(1, len(vectors) + 1), vectors, table, **options)


def medium(table):
    return [s for i, s in enumerate(table.signatures) if i % len(FACTORS) == 1]


@pytest.mark.no_cover
def test_4000_healthy_cycles_of_aging_raise_no_alarm(table):
    # 8 standard deviations of a cycle over the record: what the line cannot take, it would find
    for seed in range(20):
        assert search(table, healthy(table, 200, seed, drift=0.04)).findings == ()


def test_a_sensor_that_wanders_by_as_much_before_raises_no_alarm_and_its_fault_does(table):
    vectors = healthy(table, 40, 0)
    level = table.features.index("rest_level")
    step = 3.0 * np.sqrt(table.covariance[level][level])
    vectors[:, level] += step * np.cumsum(np.random.default_rng(100).standard_normal(40))
    assert search(table, vectors).findings == ()
    vectors[34:, level] += 25.0 * step
    found = search(table, vectors).present
    assert found is not None
    assert (found.part, found.onset) == ("sensor", 35)


@pytest.mark.no_cover
def test_medium_faults_are_found_at_their_second_cycle_and_named(table):
    told = isolability(table)
    named = 0
    for seed, signature in enumerate(medium(table)):
        vectors = with_fault(table, healthy(table, ONSET + 8, seed, drift=0.04), signature)
        found = search(table, vectors).present
        assert found is not None, signature.fault
        assert found.alarm - ONSET <= 5, signature.fault
        assert abs(found.onset - (ONSET + 1)) <= 1
        named += found.fault in told.together(signature.fault)
    assert named >= len(medium(table)) - 1


@pytest.mark.no_cover
def test_the_size_is_told(table):
    leak = next(s for s in medium(table) if s.fault == "leak")
    sizes = [
        search(table, with_fault(table, healthy(table, ONSET + 7, seed), leak)).present.severity
        for seed in range(10)
    ]
    # 12 standard deviations a cycle, 6 cycles against a line of 40: 5 % each
    assert np.mean(sizes) == pytest.approx(leak.severity, rel=0.06)


def test_a_fault_that_goes_is_over_and_the_next_is_found(table):
    first, second = (s for s in medium(table) if s.fault in {"leak", "dead_band"})
    vectors = with_fault(table, healthy(table, 160, 3), first, end=ONSET + 12)
    vectors = with_fault(table, vectors, second, start=140)
    diagnosis = search(table, vectors)
    assert [f.fault for f in diagnosis.findings] == ["leak", "dead_band"]
    assert ONSET + 12 < diagnosis.findings[0].end <= ONSET + 20
    assert diagnosis.present is diagnosis.findings[1]


def test_a_fault_soon_after_another_is_judged_by_what_was_before_both(table):
    first, second = (s for s in medium(table) if s.fault in {"leak", "dead_band"})
    vectors = with_fault(table, healthy(table, 95, 3), first, end=ONSET + 12)
    vectors = with_fault(table, vectors, second, start=ONSET + 18)
    found = search(table, vectors).present
    assert found is not None
    assert found.fault == "dead_band"
    assert found.alarm <= ONSET + 18 + 5


def test_maintenance_ends_a_fault_and_asks_for_patience(table):
    leak = next(s for s in medium(table) if s.fault == "leak")
    vectors = with_fault(table, healthy(table, 100, 4), leak)
    diagnosis = search(table, vectors, restarts=[93])
    assert diagnosis.findings[0].end == 93
    assert diagnosis.present is None
    assert not diagnosis.ready


def white_of(table):
    return whitener(with_floor(np.array(table.covariance), np.array(table.floor)))


def falling_then_rising(table, seed, back=8):
    """Return 12 cycles of a sensor that wanders down, and 8 in which it wanders `back` times."""
    offset = next(s for s in table.signatures if s.fault == "sensor_offset")
    way = np.concatenate((-np.arange(12.0), -11.0 + back * np.arange(1.0, 9.0)))
    return healthy(table, 20, seed) + 0.5 * way[:, None] * np.array(offset.change)


def test_what_wanders_down_and_up_again_is_no_sudden_change(table):
    # 4 cycles back: 10 deviations off the line down, and the level of the first cycles
    for seed in range(10):
        assert search(table, falling_then_rising(table, seed, back=1)).findings == ()
    # the same line down, and a step that leaves the level of the first cycles far behind
    stepped = falling_then_rising(table, 3, back=1)
    offset = [s for s in table.signatures if s.fault == "sensor_offset"][1]
    stepped[13:] += 3.0 * np.array(offset.change)
    found = search(table, stepped).present
    assert found is not None
    assert found.fault == "sensor_offset"


@pytest.mark.no_cover
def test_a_change_that_comes_slowly_is_less_often_taken_for_a_sudden_one(table, monkeypatch):
    leak = np.array([s for s in table.signatures if s.fault == "leak"][1].change)
    way = np.clip(np.arange(100.0) - ONSET, 0.0, None)[:, None]  # 0.4 deviations a cycle
    alarms = []
    for abrupt, beyond in ((alarm.ABRUPT, BEYOND), (-np.inf, -np.inf)):
        monkeypatch.setattr(alarm, "ABRUPT", abrupt)
        monkeypatch.setattr(alarm, "BEYOND", beyond)
        vectors = (healthy(table, 100, seed) + 0.4 / 12.0 * way * leak for seed in range(8))
        alarms.append(sum(bool(search(table, v).findings) for v in vectors))
    assert alarms[0] < alarms[1]


@pytest.mark.no_cover
def test_a_valve_unlike_the_simulated_one_is_named_right_more_often(table):
    told = isolability(table)
    white = white_of(table)
    large = [s for i, s in enumerate(table.signatures) if i % len(FACTORS) == 2]
    right = {0.0: 0, DetectionConfig().unlike: 0}
    for seed, signature in enumerate(large):
        random = np.random.default_rng(seed)
        size = np.linalg.norm(white @ np.array(signature.change))
        odd = random.standard_normal(len(white))
        odd *= 0.3 * size / np.linalg.norm(odd)
        vectors = with_fault(table, healthy(table, ONSET + 8, seed), signature)
        vectors[ONSET:] += np.linalg.solve(white, odd)
        for unlike in right:
            found = search(table, vectors, config=DetectionConfig(unlike=unlike)).present
            right[unlike] += found is not None and found.fault in told.together(signature.fault)
    assert right[DetectionConfig().unlike] > right[0.0]


def test_one_wild_cycle_is_no_fault(table):
    vectors = healthy(table, 120, 5)
    leak = next(s for s in table.signatures if s.fault == "leak")
    vectors[70] += 10.0 * np.array(leak.change)
    assert search(table, vectors).findings == ()


def test_a_change_like_no_signature_is_unknown(table):
    vectors = healthy(table, ONSET + 8, 6)
    white = white_of(table)
    # every feature at once, against the signs of every fault that it could be
    rays = np.array([s.change for s in table.signatures]) @ white.T
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    odd = np.linalg.svd(rays)[2][-1]
    odd = 0.9 * odd + 0.45 * rays[0]
    vectors[ONSET:] += 60.0 * np.linalg.solve(white, odd)
    found = search(table, vectors).present
    assert found is not None
    assert found.fault == UNKNOWN


def test_missing_features_neither_alarm_nor_hide(table):
    vectors = healthy(table, ONSET + 8, 7)
    vectors[30:34] = np.nan
    vectors[::5, 3] = np.nan
    assert search(table, vectors).findings == ()
    leak = next(s for s in medium(table) if s.fault == "leak")
    found = search(table, with_fault(table, vectors, leak)).present
    assert found is not None
    assert found.fault == "leak"


@pytest.mark.no_cover
def test_scatter_of_the_valve_itself_counts(table):
    # three times as noisy as the simulated valve: nothing may be found in it
    for seed in range(10):
        assert search(table, 3.0 * healthy(table, 200, seed)).findings == ()


@pytest.mark.parametrize("cycles", [0, 1, 5, 9])
def test_too_few_cycles_say_nothing(table, cycles):
    diagnosis = search(table, healthy(table, cycles, 8))
    assert diagnosis.findings == ()
    assert not diagnosis.ready


@pytest.mark.no_cover
def test_the_past_is_not_rewritten_by_what_comes(table):
    leak = next(s for s in medium(table) if s.fault == "leak")
    vectors = with_fault(table, healthy(table, 120, 9), leak)
    known = [search(table, vectors[:n]).present for n in range(ONSET + 8, 100, 3)]
    assert all(f is not None for f in known)
    assert len({(f.fault, f.onset, f.alarm, f.severity) for f in known}) == 1


@pytest.mark.parametrize("start", [22, 30, 38])
def test_a_fault_of_the_first_cycles_is_not_learnt_as_scatter(table, start):
    leak = [s for s in table.signatures if s.fault == "leak"][2]
    vectors = with_fault(table, healthy(table, 120, 21), leak, start=start)
    known = [search(table, vectors[:n]).present for n in range(start + 4, 100, 5)]
    assert all(f is not None and f.fault == "leak" for f in known)
    assert len({(f.onset, f.alarm) for f in known}) == 1


def test_a_sensor_frozen_for_some_cycles_is_over_when_it_moves_again(table):
    vectors = healthy(table, 60, 22)
    repeats = table.features.index("repeats")
    vectors[40:43] = np.nan
    vectors[40:43, repeats] = 1.0
    vectors[40:43, table.features.index("stuck")] = 1.0
    (found,) = search(table, vectors).findings
    assert (found.fault, found.severity) == ("sensor_freeze", 1.0)
    assert found.end == 48


def test_a_noisier_sensor_is_named(table):
    vectors = healthy(table, 60, 23)
    vectors[45:, table.features.index("rest_noise")] += np.log(4.0)
    found = search(table, vectors).present
    assert found is not None
    assert found.fault == "sensor_noise"
    assert found.severity == pytest.approx(4.0, rel=0.1)


def test_no_size_is_none_or_more_than_all(table):
    most = {s.fault: s for s in table.signatures}
    vectors = with_fault(table, healthy(table, 70, 24), most["command_loss"])
    vectors[ONSET:] += 20.0 * np.array(most["command_loss"].change)
    for finding in search(table, vectors).findings:
        assert not 0.0 <= abs(finding.severity) < 1e-6
        assert finding.fault != "command_loss" or finding.severity <= 1.0


def test_inseparable_faults_are_named(table):
    told = isolability(table)
    assert {c for c in told.classes if len(c) > 1} == {
        ("preload", "coil_resistance"),
        ("sensor_gain", "supply_drop"),
    }
    assert told.together("leak") == ("leak",)
    # the output scaled is the gains scaled: no cycle can tell
    a, b = (told.faults.index(n) for n in ("sensor_gain", "supply_drop"))
    assert told.distance[a, b] < told.distance[a, told.faults.index("preload")]


def test_signatures_stand_size_by_size(table):
    for name in table.faults:
        sizes = [s.severity for s in table.signatures if s.fault == name]
        assert len(sizes) % len(SIZES) == 0
        assert np.allclose(np.array(sizes[:3]) / sizes[0], FACTORS)
    assert len({len(s.change) for s in table.signatures}) == 1


@pytest.mark.no_cover
@pytest.mark.parametrize("histories", [20, pytest.param(600, marks=pytest.mark.slow)])
def test_whatever_comes_nothing_raises(table, histories):
    random = np.random.default_rng(12)
    for _ in range(histories):
        vectors = healthy(table, int(random.integers(20, 90)), int(random.integers(10**6)))
        scale = np.sqrt(np.diag(with_floor(np.array(table.covariance), np.array(table.floor))))
        for _ in range(int(random.integers(1, 6))):
            first = int(random.integers(len(vectors)))
            part = slice(first, first + int(random.integers(1, 20)))
            vectors[part] += (
                scale * random.standard_normal(len(scale)) * 10.0 ** random.uniform(0, 3)
            )
        vectors[random.random(vectors.shape) < 0.05] = np.nan
        diagnosis = search(table, vectors)
        assert all(f.onset <= f.alarm for f in diagnosis.findings)


@pytest.mark.parametrize("size", [1e140, 1e200, 1e260, 1e300])
@pytest.mark.parametrize("first", [3, 45])
def test_a_feature_of_any_size_is_judged_like_a_large_one(table, size, first):
    vectors = healthy(table, 60, 5)
    large = vectors.copy()
    vectors[first:, 2], large[first:, 2] = size, 1e100
    found, expected = search(table, vectors).findings, search(table, large).findings
    assert [(f.fault, f.onset) for f in found] == [(f.fault, f.onset) for f in expected]
    assert len(found) == (first == 45)
    assert np.isfinite([f.deviation for f in found]).all()


def test_a_cycle_that_shows_nothing_neither_confirms_nor_ends_a_fault(table):
    leak = next(s for s in medium(table) if s.fault == "leak")
    vectors = healthy(table, ONSET + 12, 4)
    wild = vectors.copy()
    wild[ONSET] += 2.0 * np.array(leak.change)
    wild[ONSET + 1] = np.nan
    assert search(table, wild[: ONSET + 2]).findings == ()
    lasts = with_fault(table, vectors, leak)
    lasts[ONSET + 6] = vectors[ONSET + 6]  # one cycle without it, then nothing
    lasts[ONSET + 7 :] = np.nan
    assert search(table, lasts).present is not None
