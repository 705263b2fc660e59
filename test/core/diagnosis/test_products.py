# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What changes features without a fault: another product, a sample's slip, clocks apart."""

import numpy as np
import pytest

from valve_twin.core.diagnosis.products import (
    MADE,
    behind_a_pause,
    clocks_apart,
    last_left,
    products,
    with_returns,
    without_timed,
)

CYCLES = np.arange(1, 41)
START_S = 12.0 * np.arange(40.0)


def delays(table, into, out):
    """Return (40, F) features, all 0 but the delays of both strokes."""
    vectors = np.zeros((len(CYCLES), len(table.features)))
    vectors[:, table.features.index("delay_in")] = into
    vectors[:, table.features.index("delay_out")] = out
    return vectors


def test_programs_of_different_length_are_different_products():
    rng = np.random.default_rng(1)
    turns = np.where(np.arange(40) % 2 == 0, 12.0, 12.5) + 0.01 * rng.standard_normal(40)
    turns[7] += 20.0  # a pause
    found = products(turns)
    assert found[7] == -1
    assert set(found[np.arange(40) % 2 == 0].tolist()) == {0}
    assert len(set(np.delete(found, 7).tolist())) == 2


def test_durations_that_differ_at_will_tell_no_product():
    found = products(np.random.default_rng(2).uniform(5.0, 60.0, 40))
    assert set(found.tolist()) == {0}


def test_durations_that_scatter_are_one_product_and_a_pause_is_none():
    rng = np.random.default_rng(7)
    scattered = 30.0 + 0.6 * rng.standard_normal((20, 40))
    ranked = np.sort(scattered, axis=1)
    by_chance = (np.diff(ranked, axis=1) > 0.01 * ranked[:, 1:]).any(axis=1)
    assert np.mean(by_chance) > 0.4
    for durations in scattered:
        found = products(durations)
        assert len(set(found.tolist()) - {-1}) == 1


def test_programs_that_differ_by_less_than_a_hundredth_are_two_where_a_gap_is_clear():
    jitter = 0.04 * (np.arange(40) % 3 == 0)  # a sample more or less
    durations = np.where(np.arange(40) < 15, 13.32, 13.16) + jitter
    assert products(durations).tolist() == [1] * 15 + [0] * 25
    assert products(durations[:18]).tolist() == [0] * 15 + [-1] * 3  # too few yet to be one
    assert set(products(8.0 + jitter).tolist()) == {0}


def test_pauses_are_no_durations_that_differ_at_will():
    durations = np.full(28, 13.4)
    durations[[8, 20, 22, 25]] = 40.0, 47.0, 45.0, 26.0
    durations[[23, 24, 26, 27]] = 13.2, 12.7, 12.7, 12.7  # another product has just begun
    found = products(durations)
    assert set(found[:8].tolist()) == {0}
    assert set(found[23:].tolist()) == {-1}


def test_a_product_that_has_just_begun_is_none_of_those_before_at_any_number_of_cycles():
    """Stranger 96135: it was one product for as long as a third of the cycles were odd."""
    durations = np.where(np.arange(17) < 11, 14.76, 12.12)
    durations[[1, 11]] = 19.0, 14.64  # a short pause, and a cycle that is half of each
    for count in range(13, 16):
        assert products(durations[:count])[12:].tolist() == [-1] * (count - 12)
        assert products(durations[:count])[2:11].tolist() == [0] * 9
    assert products(durations)[12:].tolist() == [0] * 5
    assert products(durations)[2:11].tolist() == [1] * 9


def test_pauses_are_no_product_however_long():
    durations = np.full(39, 13.16)
    paused = [1, 22, 24, 30, 34]
    durations[paused] = 23.68, 39.56, 19.16, 47.64, 50.28
    found = products(durations)
    assert np.flatnonzero(found < 0).tolist() == paused
    assert set(np.delete(found, paused).tolist()) == {0}


def test_programs_that_are_as_long_but_return_at_another_time_are_two_products():
    """Stranger 95025: 11.43 and 11.52 s long, they return after 8.07 and 7.71 s."""
    times = np.full(20, 8.07)
    times[12:] = 7.71
    times[1::2] += 0.03
    one = np.zeros(20, dtype=np.int64)
    assert with_returns(one, times).tolist() == [1] * 12 + [0] * 8
    assert with_returns(one[:15], times[:15]).tolist() == [0] * 12 + [-1] * 3
    times[4] = np.nan
    assert with_returns(one, times).tolist() == [1] * 4 + [-1] + [1] * 7 + [0] * 8


def test_a_pause_comes_before_the_next_cycle_of_every_product():
    """Of recipes in turn it was known of the first that was made behind a pause alone."""
    product = np.array([-1, 0, 1, 0, 1, -1, 0, 1, 0, -1, -1, 0, 1])
    shown = {n: behind_a_pause(product, product == n).tolist() for n in (0, 1)}
    assert shown[0] == [False, False, True, False, True]
    assert shown[1] == [False, False, True, True]
    assert behind_a_pause(np.zeros(3, dtype=np.int64), slice(None)).tolist() == [False] * 3


def test_cycles_of_an_older_version_stay_a_product_where_times_of_return_take_others_apart():
    """They were of no product at all, and with them a fault that lasts."""
    older, one = np.full(20, np.nan), np.zeros(32, dtype=np.int64)
    odd = np.concatenate((older, np.full(12, 8.07)))
    odd[25] = 8.5
    assert with_returns(one, odd).tolist() == [0] * 25 + [-1] + [0] * 6
    two = np.concatenate((older, np.where(np.arange(12) % 2, 8.07, 7.71)))
    assert with_returns(one, two).tolist() == [2] * 20 + [0, 1] * 6


def test_a_sample_more_or_less_is_no_other_program():
    """A return after 3 s that was logged a sample later was another product, or none at all."""
    one = np.zeros(20, dtype=np.int64)
    for period_s in (0.01, 0.02, 0.03, 0.04):
        samples = round(3.0 / period_s) + np.arange(20.0) % 2.0
        assert with_returns(one, np.asarray(period_s * samples, np.float64)).tolist() == [0] * 20
    few = np.full(20, 3.0)
    few[[3, 11]] += 0.04
    assert with_returns(one, few).tolist() == [0] * 20
    begins = np.where(np.arange(20) % 3, 0.0, 0.02)
    assert with_returns(one, begins).tolist() == [0] * 20


def test_how_long_a_sample_is_the_cycles_tell():
    """At 10 Hz a return that was logged a sample later was another product."""
    one, slow, fast = np.zeros(20, dtype=np.int64), np.full(20, 0.1), np.full(20, 1e-3)
    later = np.where(np.arange(20) % 2, 3.1, 3.0)
    assert set(with_returns(one, later).tolist()) == {0, 1}  # none tells it
    assert set(with_returns(one, later, slow).tolist()) == {0}
    near = np.where(np.arange(20) % 2, 3.04, 3.0)
    assert set(with_returns(one, near).tolist()) == {0}
    assert set(with_returns(one, near, fast).tolist()) == {0, 1}
    slow[4] = fast[4] = np.nan  # of an older version, as cycles of any valve were: 40 ms at least
    assert set(with_returns(one, later, slow).tolist()) == {0}
    assert set(with_returns(one, near, fast).tolist()) == {0}


def test_times_of_return_leave_alone_what_they_do_not_tell():
    product = np.array([-1] + [0] * 9 + [1] * 10)
    jitter = np.full(20, 8.0)
    jitter[1::3] += 0.03
    jitter[12] = np.nan
    assert with_returns(product, jitter).tolist() == product.tolist()
    none = np.full(20, np.nan)
    assert with_returns(product, none).tolist() == product.tolist()


@pytest.mark.parametrize("odd", [0.1, 2.0, 4.0, 9.0])
def test_one_cycle_that_returns_oddly_leaves_the_products_apart(odd):
    times = np.where(np.arange(40) % 2, 3.0, 5.0)
    times[7] = odd
    found = with_returns(np.zeros(40, dtype=np.int64), times)
    assert np.flatnonzero(found < 0).tolist() == [7]
    assert set(found[::2].tolist()) == {1}
    assert np.count_nonzero(found == 0) == 19


def test_more_than_two_programs_are_told_by_their_returns():
    times = np.array([2.0, 3.0, 4.0])[np.arange(39) % 3]
    found = with_returns(np.zeros(39, dtype=np.int64), times)
    assert found.tolist() == [0, 1, 2] * 13


@pytest.mark.parametrize("rate", [350e-6, -280e-6])
def test_clocks_apart_are_found_by_their_rate(table, rate):
    noise = 1e-3 * np.random.default_rng(3).standard_normal((2, 40))
    vectors = delays(table, 0.01 + rate * START_S + noise[0], 0.02 + rate * START_S + noise[1])
    found = clocks_apart(CYCLES, START_S, vectors, table)
    assert found is not None
    assert found.fault == "clock"
    assert found.severity == pytest.approx(rate, rel=0.05)


def test_clocks_once_found_stay_found_when_the_delay_is_longer_than_is_searched(table):
    noise = 1e-3 * np.random.default_rng(3).standard_normal((2, 40))
    away = 350e-6 * START_S + noise[0], 350e-6 * START_S + noise[1]
    wrapped = [np.where(CYCLES > 26, 0.03 * noise[0], d) for d in away]
    found = clocks_apart(CYCLES, START_S, delays(table, *wrapped), table)
    assert found is not None
    assert found.severity == pytest.approx(350e-6, rel=0.1)
    assert found.alarm == CYCLES[-1]


def test_clocks_apart_are_found_though_the_delay_climbs_in_samples_and_stay_found(table):
    """Strangers 96006, 95044: samples slip, and one look may find what the next does not."""
    noise = 1e-3 * np.random.default_rng(6).standard_normal(40)
    climbs = 0.02 * np.floor(300e-6 * START_S / 0.02) + 1e-4 * START_S + noise
    vectors = delays(table, np.full(40, np.nan), climbs)
    found = [
        clocks_apart(CYCLES[:n], START_S[:n], vectors[:n], table) is not None for n in range(8, 41)
    ]
    assert found == sorted(found)
    assert 15 <= len(found) - sum(found) + 8 <= 20  # 40 ms lie between these cycles


def test_delays_that_warm_up_and_settle_are_clocks_apart_no_more(table):
    for seed in range(20):
        noise = 5e-4 * np.random.default_rng([8, seed]).standard_normal((2, 40))
        warm = 0.02 * (1.0 - np.exp(-np.arange(40) / 6.0))
        vectors = delays(table, warm + noise[0], warm + noise[1])
        assert clocks_apart(CYCLES, START_S, vectors, table) is None


def test_what_slides_between_clocks_apart_is_not_shown(table):
    shown = dict(zip(table.features, without_timed(np.zeros((2, 13)), table).T, strict=True))
    hidden = {name for name, values in shown.items() if np.isnan(values).all()}
    assert hidden == {"delay_in", "delay_out", "shortfall"}


def test_a_delay_that_comes_back_by_a_sample_is_no_clock_apart(table):
    noise = 1e-3 * np.random.default_rng(5).standard_normal(40)
    drift = 88e-6 * START_S
    beat = drift - 0.04 * (drift >= drift[-1])  # the newest cycle is a sample earlier
    none = np.full(40, np.nan)
    assert clocks_apart(CYCLES, START_S, delays(table, none, drift + noise), table) is not None
    assert clocks_apart(CYCLES, START_S, delays(table, none, beat + noise), table) is None


def test_one_pilot_that_becomes_slower_and_a_step_are_no_clocks_apart(table):
    noise = 1e-3 * np.random.default_rng(4).standard_normal((2, 40))
    slower = delays(table, 0.01 + 5e-5 * START_S + noise[0], 0.02 + noise[1])
    assert clocks_apart(CYCLES, START_S, slower, table) is None
    step = 0.05 * (CYCLES > 20)
    assert (
        clocks_apart(CYCLES, START_S, delays(table, step + noise[0], step + noise[1]), table)
        is None
    )


def test_a_product_is_left_where_others_are_made_for_long():
    product = np.array([0] * 12 + [1] * MADE + [-1] + [0] * 3 + [1] * (MADE - 1))
    cycles = np.arange(1, len(product) + 1)
    assert last_left(cycles, product, 0) == 12
    assert last_left(cycles[: 11 + MADE], product[: 11 + MADE], 0) == -1
    assert last_left(cycles, product, 1) == -1
    in_turn = np.arange(40) % 2
    assert last_left(np.arange(40), in_turn, 1) == -1
