# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the time between logger and controller does to delays is taken out, a fault is not."""

import numpy as np

from valve_twin.core.diagnosis.changes.slips import Slips

CYCLES = np.arange(1, 41)
PAUSED = CYCLES == 21


def timed(table, into, out, lacks=0.0):
    """Return (40, F) features, all 0 but the delays of both strokes and the shortfall."""
    vectors = np.zeros((len(CYCLES), len(table.features)))
    for name, values in (("delay_in", into), ("delay_out", out), ("shortfall", lacks)):
        vectors[:, table.features.index(name)] = values
    return vectors


def test_a_sample_more_between_the_signals_is_taken_out_and_a_slower_valve_is_not(table):
    late = 0.03 * (CYCLES > 20)
    alone = Slips().taken_out(timed(table, np.zeros(40), late), table)
    assert np.ptp(alone) == 0.0
    both = timed(table, late, late)
    assert np.array_equal(Slips().taken_out(both, table), both)


def test_a_delay_that_jumps_in_every_cycle_keeps_its_scatter(table):
    turns = 0.03 * (CYCLES % 2)
    column = Slips().taken_out(timed(table, 0.0, turns), table)[
        :, table.features.index("delay_out")
    ]
    assert np.std(column[10:]) > 5e-3


def test_a_pause_shifts_all_that_follow_by_a_part_of_a_sample(table):
    """Strangers 96016, 93268: gas in the chamber of 0.2 was told."""
    noise = np.random.default_rng(1).standard_normal((2, 40))
    late = 7e-3 * (CYCLES > 20) + 1e-4 * noise[0]
    lacks = -0.4 * (CYCLES > 20) + 0.03 * noise[1]
    given = timed(table, np.nan, late, lacks)
    out = Slips().taken_out(given, table, PAUSED)
    for name, scatter in (("delay_out", 1e-4), ("shortfall", 0.03)):
        column = out[:, table.features.index(name)]
        moved = column[21:].mean() - column[:20].mean()
        assert abs(moved) < 3.0 * scatter
        assert np.std(column) < 1.5 * scatter
    assert np.array_equal(Slips().taken_out(given, table), given, equal_nan=True)


def test_a_jump_that_no_pause_comes_before_and_one_beyond_a_sample_stay(table):
    later = timed(table, np.nan, 7e-3 * (CYCLES > 25))
    assert np.array_equal(Slips().taken_out(later, table, PAUSED), later, equal_nan=True)
    far = timed(table, np.nan, 0.1 * (CYCLES > 20))
    first = slice(0, 23)  # behind these the jump is what is usual in half of the cycles
    assert np.array_equal(Slips().taken_out(far, table, PAUSED)[first], far[first], equal_nan=True)


def test_what_a_pause_did_is_taken_out_of_the_first_cycle_that_shows_the_delay(table):
    late = 7e-3 * (CYCLES > 20)
    late[20:24] = np.nan
    column = Slips().taken_out(timed(table, np.nan, late), table, PAUSED)[
        :, table.features.index("delay_out")
    ]
    assert np.ptp(column[np.isfinite(column)]) == 0.0


def test_what_is_taken_out_is_the_same_cycle_by_cycle(table):
    rng = np.random.default_rng(2)
    late = 7e-3 * (CYCLES > 20) + 1e-4 * rng.standard_normal(40)
    given, grown = timed(table, 1e-3 * rng.standard_normal(40), late), Slips()
    for count in range(1, 41):
        shown = grown.taken_out(given[:count], table, PAUSED[:count])
    assert np.array_equal(shown, Slips().taken_out(given, table, PAUSED))
    otherwise = np.roll(PAUSED, 3)
    anew = grown.taken_out(given, table, otherwise)
    assert np.array_equal(anew, Slips().taken_out(given, table, otherwise))


def test_a_sample_is_as_long_as_the_cycles_tell(table):
    """At 1 kHz a delay of the outflow that jumps by 30 ms alone is a valve that sticks."""
    late = 0.03 * (CYCLES > 20)
    given = timed(table, np.zeros(40), late)
    fast, slow = np.full(40, 1e-3), np.full(40, 0.03)
    assert np.array_equal(Slips().taken_out(given, table, period_s=fast), given)
    assert np.ptp(Slips().taken_out(given, table, period_s=slow)) == 0.0
    short = timed(table, np.zeros(40), 1e-3 * (CYCLES > 20))
    assert np.ptp(Slips().taken_out(short, table, period_s=fast)) == 0.0
    paused = timed(table, np.nan, 7e-3 * (CYCLES > 20))  # seven samples, which no pause explains
    out = Slips().taken_out(paused, table, PAUSED, fast)
    assert np.array_equal(out, paused, equal_nan=True)
    assert np.ptp(np.nan_to_num(Slips().taken_out(paused, table, PAUSED, slow))) == 0.0
