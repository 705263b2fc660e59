# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import numpy as np
import pytest

from valve_twin.core.aging.laws.shapes import LawFit
from valve_twin.core.aging.life import MAX_STAMP_NS, Approach, Remaining, axis_rate, date_after
from valve_twin.core.aging.trend import fit_line, quantile

INF = float("inf")


def approach(gap, slope, *, var_gap, cov, var_slope, freedom) -> Approach:
    """Return the way of one line to a threshold: one axis unit to u = 1, gap still to go."""
    one = np.ones(1)
    line = LawFit(
        start=-1.0,
        length=1.0,
        law=np.zeros(1, np.int64),
        number=0.0 * one,
        weight=one,
        level=one,
        change=slope * one,
        level_weights=np.ones((1, 1)),
        change_weights=np.ones((1, 1)),
        values=one,
        sigma=one,
        autocorrelation=0.0,
        freedom=freedom,
        line=1.0,
    )
    spread = var_gap * one, -cov * one, var_slope * one
    return Approach(line, 0.0, -gap * one, slope * one, *spread)


def remaining_life(gap, slope, **doubt) -> Remaining:
    return approach(gap, slope, **doubt).remaining()


def life_of(y, threshold):
    """Remaining life of a falling line over 1, 2, ... to an absolute threshold."""
    x = np.arange(1.0, len(y) + 1.0)
    line = fit_line(x, y)
    now = x[-1]
    return remaining_life(
        line.level(now) - threshold,
        -line.slope,
        var_gap=line.level_variance(now),
        cov=-(line.cov + (now - line.center) * line.var_slope),
        var_slope=line.var_slope,
        freedom=line.freedom,
    )


def test_limits_are_those_of_fieller():
    g, s, vg, c, vs, nu = 6.0, 0.13, 0.4, -0.003, 2e-4, 58.0
    t = quantile(nu, 0.95)
    a, b, k = s * s - t * t * vs, s * g - t * t * c, g * g - t * t * vg
    root = np.sqrt(b * b - a * k)
    life = remaining_life(g, s, var_gap=vg, cov=c, var_slope=vs, freedom=nu)
    assert life.low == pytest.approx((b - root) / a, rel=1e-5)
    assert life.high == pytest.approx((b + root) / a, rel=1e-5)
    assert life.median == pytest.approx(g / s, rel=1e-5)
    assert not life.unbounded


def test_uncertain_slope_is_unbounded_but_has_an_early_limit():
    life = remaining_life(6.0, 0.02, var_gap=0.4, cov=0.0, var_slope=4e-4, freedom=20.0)
    assert life.unbounded
    assert 0.0 < life.low < life.median == pytest.approx(300.0, rel=1e-5)


def test_slope_away_from_the_threshold_is_none_in_sight():
    life = remaining_life(6.0, -0.5, var_gap=0.4, cov=0.0, var_slope=1e-4, freedom=20.0)
    assert (life.low, life.median, life.high) == (INF, INF, INF)


def test_nothing_remains_beyond_the_threshold():
    life = remaining_life(-3.0, 0.1, var_gap=0.1, cov=0.0, var_slope=1e-4, freedom=20.0)
    assert (life.low, life.median, life.high) == (0.0, 0.0, 0.0)


def test_just_beyond_the_threshold_may_still_have_a_little_left():
    life = remaining_life(-0.1, 0.1, var_gap=0.1, cov=0.0, var_slope=1e-4, freedom=20.0)
    assert life.low == life.median == 0.0
    assert 0.0 < life.high < 10.0


def test_exact_line_has_an_exact_life():
    life = remaining_life(5.0, 0.5, var_gap=0.0, cov=0.0, var_slope=0.0, freedom=20.0)
    assert (life.low, life.median, life.high) == pytest.approx((10.0, 10.0, 10.0))


@pytest.mark.parametrize(("n", "least", "most"), [(60, 0.93, 0.975), (105, 0.92, 0.97)])
def test_limits_cover_the_true_crossing(scatter, n, least, most):
    """equations.md 2.5 (-13.6 % in 105 cycles, scatter 2.7 %, limit -20 %): 94.9 and 94.4 %."""
    slope = -0.136 / 105
    true = (0.8 - (1.0 + slope * n)) / slope
    hits = 0
    for seed in range(500):
        life = life_of(1.0 + slope * np.arange(1, n + 1) + 0.027 * scatter(seed, n), 0.8)
        hits += life.low <= true <= life.high
    # binomial standard deviation 1 % of 500 draws
    assert least <= hits / 500 <= most


def test_fifteen_cycles_are_mostly_unbounded(scatter):
    """equations.md 2.5: 88 % of histories of 15 cycles, 40 % of 30."""
    share = {}
    for n in (15, 30):
        y = [1.0 - 0.136 / 105 * np.arange(1, n + 1) + 0.027 * scatter(s, n) for s in range(300)]
        share[n] = np.mean([life_of(v, 0.8).unbounded for v in y])
    assert 0.80 <= share[15] <= 0.96
    assert 0.32 <= share[30] <= 0.56


def test_median_halves_the_histories(scatter):
    slope, n = -0.136 / 105, 60
    true = (0.8 - (1.0 + slope * n)) / slope
    early = [
        life_of(1.0 + slope * np.arange(1, n + 1) + 0.027 * scatter(s, n), 0.8).median < true
        for s in range(400)
    ]
    assert 0.44 <= np.mean(early) <= 0.56  # binomial standard deviation 2.5 %


def test_probability_before_a_stop_is_that_of_the_limits():
    way = approach(6.0, 0.13, var_gap=0.4, cov=-0.003, var_slope=2e-4, freedom=58.0)
    life = way.remaining(0.9)
    shares = [way.before(r) for r in (life.low, life.median, life.high)]
    assert shares == pytest.approx([0.05, 0.5, 0.95], abs=1e-4)
    assert way.before(0.0) <= way.before(1.0) <= way.before(1e6) <= 1.0


def test_rate_and_date_come_from_the_stamps():
    stamps = np.arange(20, dtype=np.int64) * 30_000_000_000
    rate = axis_rate(np.arange(20.0), stamps, 10)
    assert rate == pytest.approx(1 / 30)
    assert date_after(int(stamps[-1]), 100.0, rate) == stamps[-1] + 3_000_000_000_000


def test_no_date_beyond_what_a_stamp_can_carry():
    assert date_after(0, INF, 1.0) == 0
    assert date_after(0, 10.0, float("nan")) == 0
    assert date_after(MAX_STAMP_NS - 10**9, 2.0, 1.0) == 0


def test_rate_of_one_cycle_is_unknown():
    assert np.isnan(axis_rate(np.ones(1), np.ones(1, dtype=np.int64), 50))
