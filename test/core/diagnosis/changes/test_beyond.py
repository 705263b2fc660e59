# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Cycles that each lie beyond all before are a fault without a variance of few cycles."""

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.diagnosis.changes.beyond import first_beyond, nearer_before, wandered
from valve_twin.core.diagnosis.config import OF_A_MODEL, OF_ANY_VALVE
from valve_twin.core.diagnosis.detection import detect
from valve_twin.core.diagnosis.generic.campaign import model_rig, own_signatures
from valve_twin.core.diagnosis.generic.signatures import signatures_of
from valve_twin.core.diagnosis.watch.whitened import Whitened
from valve_twin.core.valves.registry import get_model

BEFORE = 10
OSCILLATION = 0.02
"""A large one of `first_order`: share of the span, as docs/campaigns/any_valve has it."""


@pytest.fixture(scope="module")
def table():
    return signatures_of(get_model("first_order"))


def record(table, *, step, rows=BEFORE + 5, scale=1.0):
    """Return features of which one goes off by a step behind the first cycles, (N, F)."""
    vectors = np.zeros((rows, len(table.features)))
    at = table.features.index("lag_up")
    vectors[:, at] = scale * np.where(np.arange(rows) % 2, 1.0, -1.0)
    vectors[BEFORE:, at] += scale * step
    return vectors


@pytest.mark.parametrize(("step", "cycles"), [(6.5, 2), (4.6, 3), (3.8, 4), (3.3, 5)])
def test_the_more_cycles_lie_beyond_the_less_far_they_must(table, step, cycles):
    vectors = record(table, step=step)
    row = BEFORE + cycles - 1
    assert first_beyond(vectors, table, OF_ANY_VALVE, 0) == (row, BEFORE)
    assert first_beyond(vectors[:row], table, OF_ANY_VALVE, 0) is None


def test_less_raises_no_alarm_and_neither_does_what_sampling_alone_does(table):
    assert first_beyond(record(table, step=3.0), table, OF_ANY_VALVE, 0) is None
    assert first_beyond(record(table, step=6.5, scale=1e-7), table, OF_ANY_VALVE, 0) is None
    assert first_beyond(record(table, step=99.0), table, OF_A_MODEL, 0) is None


def test_one_cycle_alone_must_have_twelve_before_it(table):
    late = np.vstack((record(table, step=0.0, rows=12), record(table, step=12.0)[-1:]))
    assert first_beyond(late, table, OF_ANY_VALVE, 0) == (12, 12)
    assert first_beyond(late[1:], table, OF_ANY_VALVE, 0) is None


def test_a_valve_that_ages_raises_none(table):
    vectors = record(table, step=0.0, rows=80, scale=0.1)
    vectors += np.arange(80.0)[:, None] * np.ones(vectors.shape[1])
    assert first_beyond(vectors, table, OF_ANY_VALVE, 0) is None


def test_what_wanders_away_raises_none(table):
    """It is beyond 2.2 times all before in five cycles, but no sudden change."""
    wanders = [0.2, -0.3, 0.4, -0.2, 0.3, 0.5, 0.9, 1.0, 2.4, 2.6, 3.0, 3.1, 3.3]
    vectors = np.zeros((len(wanders), len(table.features)))
    at = table.features.index("lag_up")
    vectors[:, at] = wanders
    assert first_beyond(vectors, table, OF_ANY_VALVE, 0) is None
    vectors[5:8, at] = (0.0, 1.0, 0.0)
    assert first_beyond(vectors, table, OF_ANY_VALVE, 0) == (12, 8)


def test_a_sound_valve_of_heavy_tails_raises_one_by_the_chance_of_one_cycle_alone(table):
    """Student's t with three degrees of freedom, whose tail falls with the third power."""
    random = np.random.default_rng(7)
    shape, alarms, cycles = (100, len(table.features)), 0, 0
    for _ in range(300):
        found = first_beyond(random.standard_t(3, shape), table, OF_ANY_VALVE, 0)
        alarms += found is not None
        cycles += found[0] + 1 if found else shape[0]
    expected = OF_ANY_VALVE.alone * cycles
    assert alarms < expected + 3.0 * np.sqrt(expected)


@pytest.mark.parametrize("seed", range(20))
def test_neither_order_sign_nor_unit_of_features_matters_nor_what_comes_later(table, seed):
    random = np.random.default_rng(seed)
    count, width = int(random.integers(8, 80)), len(table.features)
    vectors = random.standard_t(3, (count, width))
    vectors[count // 2 :, random.integers(width)] += random.choice((-9.0, 9.0))
    vectors[random.random(vectors.shape) < random.uniform(0.0, 0.2)] = np.nan
    vectors[random.random(vectors.shape) < 0.01] = np.inf
    order, unit = random.permutation(width), 2.0 ** random.integers(-40, 41, width)
    quiet = np.diag(np.diag(np.array(table.covariance)) * unit**2)[np.ix_(order, order)]
    other = replace(
        table,
        features=tuple(table.features[k] for k in order),
        covariance=tuple(map(tuple, quiet.tolist())),
        floor=tuple((np.array(table.floor) * unit)[order].tolist()),
    )
    found = first_beyond(vectors, table, OF_ANY_VALVE, 0)
    assert first_beyond(-(vectors * unit)[:, order], other, OF_ANY_VALVE, 0) == found
    rows = range(count)
    grown = (first_beyond(vectors[: k + 1], table, OF_ANY_VALVE, k) for k in rows)
    assert next((f for f in grown if f), None) == found


def test_a_feature_that_a_new_cycle_does_not_show_says_nothing(table):
    vectors = record(table, step=6.5)
    vectors[BEFORE:, table.features.index("lag_up")] = np.nan
    assert first_beyond(vectors, table, OF_ANY_VALVE, 0) is None


def test_cycles_nearer_to_the_change_are_not_back(table):
    vectors = record(table, step=6.5, rows=BEFORE + 9)
    vectors[-3:, table.features.index("lag_up")] = (1.0, 2.0, 4.0)
    near = nearer_before(vectors, table, OF_ANY_VALVE, (BEFORE + 1, BEFORE))
    assert near is not None
    assert near[-3:].tolist() == [True, True, False]
    assert not near[BEFORE:-3].any()


@pytest.mark.no_cover
def test_a_lasting_oscillation_of_a_young_valve_is_told_in_every_longer_history():
    """It was told as over from the twelfth cycle with it on: eight cycles know no scatter."""
    rig = model_rig("first_order")
    valve = rig.start(950)
    table = own_signatures(rig, valve)
    before = rig.run(valve, 13 - valve.cycle)
    valve.set_fault("oscillation", OSCILLATION)
    rows = np.vstack((before, rig.run(valve, 18)))[:, : len(table.features)]
    cycles = np.arange(1, len(rows) + 1)
    old = replace(OF_ANY_VALVE, beyond=0.0, young=0)
    assert detect(cycles, rows, table, old).present is None
    for count in range(len(before) + 5, len(rows) + 1):
        assert detect(cycles[:count], rows[:count], table, OF_ANY_VALVE).present is not None


def wandering(table, seed, share=0.9, rows=100):
    """Return sound cycles of which each is like the one before by a share, (N, F)."""
    noise = np.random.default_rng(seed).standard_normal((rows + 60, len(table.features)))
    for k in range(1, len(noise)):
        noise[k] = share * noise[k - 1] + np.sqrt(1.0 - share**2) * noise[k]
    return noise[60:]


@pytest.mark.no_cover
def test_a_sound_valve_whose_cycles_are_like_the_last_raises_few_alarms(table):
    """24 of 24 had one, 14 by cycles beyond all before; now 9 and 1."""
    cycles = np.arange(1, 101)
    found = [detect(cycles, wandering(table, seed), table, OF_ANY_VALVE) for seed in range(24)]
    assert sum(len(d.findings) > 0 for d in found) <= 12
    first = [first_beyond(wandering(table, s), table, OF_ANY_VALVE, 0) for s in range(24)]
    assert sum(f is not None for f in first) <= 3


def test_its_large_faults_are_found_and_cycles_by_chance_ask_for_no_more(table):
    for seed in range(8):
        vectors = wandering(table, seed, rows=45)
        vectors[40:, seed] += 20.0
        assert detect(np.arange(1, 46), vectors, table, OF_ANY_VALVE).findings
        for rows in (7, 20, 40):
            assert wandered(wandering(table, seed, share=0.0), rows, OF_ANY_VALVE) < 1.1
    assert wandered(wandering(table, 1), 40, OF_ANY_VALVE) > 2.0
    assert wandered(wandering(table, 1), 40, OF_A_MODEL) == 1.0


@pytest.mark.parametrize("value", [0.0, 0.1, 1.0 / 3.0, 12.3])
def test_what_stays_as_it_is_does_not_wander(table, value):
    """Its line leaves the same rounding in every cycle, which looked like a correlation of 1."""
    rows = wandering(table, 5, share=0.0)
    usual = wandered(rows, 40, OF_ANY_VALVE)
    assert (
        wandered(np.column_stack((rows, np.full((len(rows), 9), value))), 40, OF_ANY_VALVE)
        == usual
    )


def test_what_is_shown_in_every_second_cycle_does_not_wander(table):
    """A cycle that does not show it repeats the last value."""
    rows = wandering(table, 6, share=0.0)
    rows[1::2, :-1] = np.nan
    seen = Whitened(rows, 40, table, OF_ANY_VALVE)
    assert wandered(seen.view[1], 80, OF_ANY_VALVE) > 1.5
    assert wandered(seen.measured, 80, OF_ANY_VALVE) == 1.0


@pytest.mark.parametrize("at_a_time", [1, 7])
def test_what_was_measured_is_the_same_whatever_comes_at_a_time(table, at_a_time):
    rows = wandering(table, 7, share=0.0)
    rows[::3, 2] = np.nan
    grown = Whitened(rows[:30], 30, table, OF_ANY_VALVE)
    for end in range(30 + at_a_time, len(rows) + 1, at_a_time):
        grown.grow(rows[:end])
    at_once = Whitened(rows[: len(grown)], 30, table, OF_ANY_VALVE)
    np.testing.assert_array_equal(grown.measured, at_once.measured)
    assert np.isnan(grown.measured[::3]).all()
    assert np.isfinite(grown.measured[1::3]).all()
