# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Forecasts are judged by what the history did afterwards."""

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.backtest import BacktestConfig, Forecast, backtest
from valve_twin.core.aging.config import AgingConfig, Threshold
from valve_twin.core.types import EstimateStatus, Maintenance, Parameter

INF = float("inf")
SLOPE = -0.002
PARAMETERS = [Parameter("K_in", "1", "gain", trend=True), Parameter("leak", "1/s", "leak")]
CONFIG = AgingConfig(thresholds=(Threshold("K_in", -20.0),))
FEW = BacktestConfig(most=12)


def worn(scatter, n=140, sd=0.01, seed=0, slope=SLOPE):
    """Return a gain that falls by 0.2 % a cycle."""
    return 0.01 * (1.0 + slope * np.arange(1, n + 1) + sd * scatter(seed, n))


def judge(estimates, maintenance=(), config=CONFIG, how=FEW):
    return backtest(estimates, maintenance, config, parameters=PARAMETERS, how=how)


def test_the_end_is_where_the_line_in_hindsight_reaches_the_limit(history, scatter):
    (test,) = judge(history(K_in=worn(scatter)))
    # reference = mean of cycles 1 to 10, the limit 80 % of it: the line is there at cycle 104.4
    assert test.end == pytest.approx(104.4, abs=4.0)
    assert test.reached
    assert test.limit == Threshold("K_in", -20.0)
    assert test.limit_value == pytest.approx(0.8 * 0.01 * (1.0 + 5.5 * SLOPE), rel=0.01)


def test_forecasts_are_what_was_told_that_day(history, scatter):
    estimates = history(K_in=worn(scatter))
    (test,) = judge(estimates)
    for forecast in test.forecasts:
        trend = assess(
            estimates[: int(forecast.axis)], (), CONFIG, parameters=PARAMETERS, confidence=0.9
        ).trends[0]
        told = (trend.remaining_low, trend.remaining_median, trend.remaining_high)
        assert (forecast.low, forecast.median, forecast.high) == told
        assert forecast.truth == test.end - forecast.axis


def test_a_steady_fall_is_foreseen(history, scatter):
    tests = [judge(history(K_in=worn(scatter, seed=seed)))[0] for seed in range(12)]
    assert np.mean([t.coverage for t in tests]) >= 0.8  # forecasts of one life share their data
    middle = [t.at(0.5) for t in tests]
    assert np.mean([abs(f.error) <= 0.2 for f in middle]) >= 0.75


def test_an_age_that_hastens_is_told_too_late_by_a_line_alone(history, scatter):
    cycle = np.arange(1, 141)
    values = 0.01 * (1.0 - 0.3 * (cycle / 140.0) ** 4 + 0.003 * scatter(2, 140))
    (line,) = judge(history(K_in=values), config=replace(CONFIG, laws=("line",)))
    (bent,) = judge(history(K_in=values))
    assert line.at(0.25).error > 0.2
    assert line.coverage < 0.8 <= bent.coverage
    assert bent.brier < line.brier


def test_probabilities_to_reach_the_limit_are_judged(history, scatter):
    (test,) = judge(history(K_in=worn(scatter)), how=BacktestConfig(most=60))
    assert {f.came for f in test.forecasts} == {True, False}
    assert 0.0 <= test.brier <= 0.1
    assert test.brier_skill >= 0.5
    base = np.var([float(f.came) for f in test.forecasts])
    assert test.brier_skill == pytest.approx(1.0 - test.brier / base)


def test_without_a_limit_reached_the_last_level_is_one(history, scatter):
    (test,) = judge(history(K_in=worn(scatter, n=60)))
    assert not test.reached
    assert test.end == 60.0
    assert test.limit.value == pytest.approx(
        100.0 * (1.0 + 60 * SLOPE) / (1.0 + 5.5 * SLOPE) - 100.0, abs=1.5
    )
    assert test.forecasts


def test_nothing_is_judged_of_a_steady_valve(history, scatter):
    (test,) = judge(history(K_in=worn(scatter, slope=0.0)))
    assert test.forecasts == ()
    assert test.reason.startswith("no limit reached and no drift to foresee: no significant slope")
    assert np.isnan(test.coverage)


@pytest.mark.parametrize("n", [1, 3, 9])
def test_few_estimates_are_not_enough(n, history, scatter):
    (test,) = judge(history(K_in=worn(scatter)[:n]))
    assert f"{n} of 10 estimates" in test.reason


def test_an_empty_history_has_no_life():
    assert judge([]) == ()


def test_each_maintenance_begins_a_life_that_knows_nothing_of_later_events(history, scatter):
    values = np.concatenate([worn(scatter, 120), worn(scatter, 120, seed=5)])
    event = Maintenance(0, 121, "cartridge changed", new_reference=True)
    first, second = judge(history(K_in=values), [event])
    (alone,) = judge(history(K_in=values[:120]))
    assert first == alone
    assert (second.start, second.reached) == (121.0, True)
    assert second.end == pytest.approx(120 + 104.4, abs=4.0)
    assert all(f.axis > 121.0 for f in second.forecasts)


def test_a_withdrawn_event_begins_no_life(history, scatter):
    estimates = history(K_in=worn(scatter))
    event = Maintenance(0, 61, "new seal", withdrawn=True, withdrawn_note="another valve")
    assert judge(estimates, [event]) == judge(estimates)


def test_a_jump_beyond_the_limit_ends_the_life_there(history, scatter):
    values = 0.01 * (np.where(np.arange(100) < 60, 1.0, 0.7) + 0.005 * scatter(4, 100))
    (test,) = judge(history(K_in=values))
    assert test.end == 61.0
    assert not any(f.covers for f in test.forecasts if not f.unbounded)


def test_refused_cycles_are_no_forecasts(history, scatter):
    estimates = history(K_in=worn(scatter))
    for i in range(40, 60):
        estimates[i] = replace(estimates[i], status=EstimateStatus.REFUSED)
    (test,) = judge(estimates, how=BacktestConfig(most=500))
    told = {f.axis for f in test.forecasts}
    assert told.isdisjoint(range(41, 61))
    assert 40.0 in told
    assert len(told) + test.silent == int(test.end) - 20


def test_no_more_forecasts_than_asked_for(history, scatter):
    (test,) = judge(history(K_in=worn(scatter)), how=BacktestConfig(most=7))
    assert len(test.forecasts) + test.silent == 7


def test_a_rising_parameter_reaches_the_upper_limit(history, scatter):
    (test,) = judge(history(K_in=worn(scatter, slope=0.002)), config=AgingConfig())
    assert test.limit == Threshold("K_in", 20.0)
    assert test.reached


def test_what_a_forecast_says_of_itself():
    held = Forecast(10.0, low=15.0, median=24.0, high=INF, truth=20.0)
    assert (held.covers, held.unbounded) == (True, True)
    assert held.error == pytest.approx(0.2)
    missed = replace(held, low=21.0, high=30.0)
    assert (missed.covers, missed.unbounded) == (False, False)
    assert replace(held, median=INF).error == INF
