# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Another product changes the level of a parameter, and is not taken for aging."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig, Axis, Threshold
from valve_twin.core.aging.products import product_numbers, same_product
from valve_twin.core.aging.series import order_history, series_of
from valve_twin.core.aging.verdict import TrendStatus
from valve_twin.core.diagnosis.changes.finding import CLOCK, Diagnosis, Finding
from valve_twin.core.past.columns import past_of
from valve_twin.core.past.state import AgingState
from valve_twin.core.types import (
    Condition,
    Estimate,
    EstimateStatus,
    Maintenance,
    Parameter,
    ParameterValue,
)

CYCLES = 50
SCATTER = 0.003
SECONDS = (25.0, 18.0)
STROKES = (0.4, 0.5)
GAIN = Parameter("gain", "1", "", trend=True)
ONE = np.zeros(CYCLES, int)
CHANGED = (np.arange(CYCLES) >= 20).astype(int)
IN_TURN = np.arange(CYCLES) % 2


def made(product, *, drift=0.0, step=0.0, seed=0, pauses=(), limits=np.nan):
    """Return a history that ages by `drift` over all cycles and differs by product."""
    rng = np.random.default_rng([44, seed])
    age = 1.0 + drift * np.arange(CYCLES) / CYCLES
    values = age * (1.0 + step * product) * (1.0 + SCATTER * rng.standard_normal(CYCLES))
    found, start = [], 0
    for n, (value, which) in enumerate(zip(values.tolist(), product.tolist(), strict=True), 1):
        length = round(1e9 * (SECONDS[which] + 3.7 * n * (n in pauses)))
        part = ParameterValue(
            GAIN.name,
            value,
            standard_error=SCATTER,
            lower_95=value - limits * (1.0 + step * which),
            upper_95=value + limits * (1.0 + step * which),
        )
        found.append(
            Estimate(
                model="",
                estimator="",
                cycle=n,
                start_ns=start,
                end_ns=start + length,
                parameters=(part,),
                status=EstimateStatus.ACCEPTED,
                reason="",
                used_by_trend=True,
                conditions=(Condition("stroke", STROKES[which]),),
            )
        )
        start += length
    return found


def said(estimates, **config):
    rules = AgingConfig(thresholds=(Threshold(GAIN.name, -15.0),), **config)
    return assess(estimates, (), rules, parameters=(GAIN,), confidence=0.9).trends[0]


def brought(estimates, **config):
    history = order_history(estimates, Axis.CYCLES)
    series = series_of(history, GAIN.name)
    return series, *same_product(series, history.rows, (), AgingConfig(**config))


@pytest.mark.parametrize("product", [CHANGED, IN_TURN], ids=["changed", "in_turn"])
@pytest.mark.parametrize("step", [-0.13, 0.08])
def test_drift_and_life_are_those_of_the_aging(product, step):
    held = alive = 0
    for seed in range(20):
        trend = said(made(product, drift=-0.10, step=step, seed=seed))
        reference = 1.0 - 0.10 * 4.5 / CYCLES
        true = 100.0 * ((1.0 - 0.10 * (CYCLES - 1) / CYCLES) / reference - 1.0)
        held += trend.drift_reference_lower_95 <= true <= trend.drift_reference_upper_95
        left = (1.0 - 0.85 * reference) / 0.10 * CYCLES - (CYCLES - 1)
        alive += trend.remaining_low <= left <= trend.remaining_high
        assert trend.segments == 1
    assert held >= 18
    assert alive >= 17


def test_a_change_of_product_is_no_life():
    for seed in range(10):
        trend = said(made(CHANGED, step=-0.13, seed=seed))
        assert trend.unbounded
        assert "level of another product taken out (-1" in trend.reason


def test_a_change_once_costs_certainty_and_products_in_turn_do_not():
    widths = []
    for product in (ONE, IN_TURN, CHANGED):
        trend = said(made(product, drift=-0.10, step=-0.1))
        widths.append(trend.slope_upper_95 - trend.slope_lower_95)
    assert widths[1] < 1.15 * widths[0]
    assert widths[2] > 1.3 * widths[0]


def test_products_in_turn_may_differ_by_much():
    """A leak was 22 times as large in every second cycle, and a factor was 5 at most."""
    for cycles in (CYCLES - 1, CYCLES):
        trend = said(made(IN_TURN, step=20.0, limits=0.02)[:cycles])
        assert abs(trend.drift_reference) < 1.0
        assert trend.drift_reference_upper_95 - trend.drift_reference_lower_95 < 5.0
        assert trend.status is TrendStatus.STEADY


def test_one_product_with_pauses_is_left_as_it_is():
    series, after, told = brought(made(ONE, drift=-0.1, pauses=(7, 19, 33)))
    assert after is series
    assert told == ""


def test_a_paused_cycle_is_told_by_its_stroke():
    _, after, _ = brought(made(CHANGED, step=-0.1, pauses=(7, 33)))
    assert len(after.values) == CYCLES
    assert after.offsets[32, 0] == 1.0
    assert after.offsets[6, 0] == 0.0


def test_the_first_cycles_of_a_new_product_wait():
    history = made((np.arange(CYCLES) >= CYCLES - 6).astype(int), step=-0.1)
    _, few, told = brought(history[:-3])
    assert len(few.values) == CYCLES - 6
    assert "3 cycles of another product left out" in told
    assert len(brought(history)[1].values) == CYCLES


def test_configured_conditions_come_first():
    series, after, _ = brought(made(CHANGED, step=-0.1), covariates=("stroke",))
    assert after is series


def test_what_is_wrong_in_every_cycle_alike_widens_the_drift():
    widths = []
    for limits in (np.nan, 0.02):
        trend = said(made(ONE, drift=-0.10, limits=limits))
        widths.append(trend.drift_reference_upper_95 - trend.drift_reference_lower_95)
    assert widths[1] > 2.0 * widths[0]


def test_no_forecast_where_the_clocks_run_apart(monkeypatch):
    history = made(ONE, drift=-0.10)
    assert not said(history).unbounded
    clock = Diagnosis((Finding(CLOCK, (), "sensor", 2e-4, 12.0, 1, CYCLES),), CYCLES, ready=True)
    module = sys.modules["valve_twin.core.aging.assess"]
    monkeypatch.setattr(module, "diagnose", lambda *_: clock)
    trend = said(history)
    assert trend.unbounded
    assert not trend.service_date_known
    assert "the clocks run apart" in trend.reason


@pytest.mark.parametrize("product", [CHANGED, IN_TURN], ids=["changed", "in_turn"])
def test_maintenance_after_the_newest_cycle_changes_no_product(product):
    """The level of another product was -13.6 %, and -8.2 % once maintenance was marked."""
    before = np.arange(CYCLES) < 14
    estimates = [
        replace(e, parameters=(replace(p, value=p.value if old else 1.2 * p.value),))
        for e, old in zip(made(product, drift=-0.1, step=-0.13), before, strict=True)
        for p in e.parameters
    ]
    history = order_history(estimates, Axis.CYCLES)
    series = series_of(history, GAIN.name)
    seals = Maintenance(estimates[14].start_ns, 15, "seals")
    oil = Maintenance(estimates[-1].end_ns + 1, CYCLES + 1, "oil")
    then, told = same_product(series, history.rows, (seals,), AgingConfig())
    now, told_now = same_product(series, history.rows, (seals, oil), AgingConfig())
    assert np.array_equal(now.values, then.values)
    assert told_now == told


def test_programs_that_are_as_long_but_return_at_another_time_are_two_products():
    """Stranger 95025: K_in was "beyond its threshold" since another product was made."""
    whole = made(ONE)
    times = np.where(CHANGED == 1, 7.71, 8.07).tolist()
    shown = [
        replace(e, estimator="features", parameters=(ParameterValue("returns", t),))
        for e, t in zip(whole, times, strict=True)
    ]
    rows = past_of(shown).features
    estimates = order_history(past_of(whole), Axis.CYCLES).rows
    assert len(rows) == len(estimates) == CYCLES
    assert product_numbers(estimates).tolist() == ONE.tolist()
    assert product_numbers(estimates, rows).tolist() == (1 - CHANGED).tolist()
    half = rows.take(np.arange(10, CYCLES))  # of the first cycles nothing is known
    assert product_numbers(estimates, half).tolist() == [2] * 10 + (1 - CHANGED)[10:].tolist()


def test_a_cycle_whose_number_comes_again_keeps_its_own_time_of_return():
    """Where the count began anew, the first run was the product of the second."""
    whole = [replace(e, cycle=(e.cycle - 1) % 25 + 1) for e in made(ONE)]
    shown = [
        replace(
            e,
            estimator="features",
            used_by_trend=False,
            parameters=(ParameterValue("returns", 7.71 if k < 25 else 8.07),),
        )
        for k, e in enumerate(whole)
    ]
    past = past_of([*whole, *shown])
    rows = order_history(past, Axis.CYCLES).rows
    assert product_numbers(rows, past.features).tolist() == [0] * 25 + [1] * 25


def test_estimates_whose_features_are_let_go_of_stay_in_the_trend():
    """Of 5000 cycles the first 2952 were left out, and the reference with them."""
    whole = made(IN_TURN, drift=-0.16, step=-0.02)
    state = AgingState(recent_features=15)
    for estimate, which in zip(whole, IN_TURN.tolist(), strict=True):
        timed = replace(
            estimate,
            end_ns=estimate.start_ns + 18 * 10**9,
            conditions=(Condition("stroke", STROKES[0]),),
        )
        state.add(timed)
        returns = ParameterValue("returns", 7.71 + 0.36 * which)
        shown = replace(timed, estimator="features", used_by_trend=False, parameters=(returns,))
        state.add(shown)
    past = state.past()
    assert len(past.features) < 30
    rules = AgingConfig(thresholds=(Threshold(GAIN.name, -15.0),))
    trend = assess(past, (), rules, parameters=(GAIN,), confidence=0.9).trends[0]
    assert trend.samples == CYCLES
    assert trend.drift_reference_lower_95 < -14.4 < trend.drift_reference_upper_95 < -10.0
