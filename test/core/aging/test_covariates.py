# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What load or stroke does to a parameter is not aging, and aging is not taken for it."""

import numpy as np
import pytest

from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig, Axis
from valve_twin.core.aging.covariates import MIN_VALUES, without_conditions
from valve_twin.core.aging.series import order_history, series_of
from valve_twin.core.aging.verdict import TrendStatus
from valve_twin.core.types import (
    Condition,
    Estimate,
    EstimateStatus,
    Maintenance,
    Parameter,
    ParameterValue,
)

CYCLES = 80
SCATTER = 0.005
PARAMETERS = (Parameter("gain", "1", "", trend=True),)


def history(values, **conditions):
    """Return one estimate a cycle with its conditions."""
    return [
        Estimate(
            model="",
            estimator="",
            cycle=n + 1,
            start_ns=n * 10**9,
            end_ns=n * 10**9 + 1,
            parameters=(
                ParameterValue("gain", float(value)),
                ParameterValue("level", float(n % 7)),
            ),
            status=EstimateStatus.ACCEPTED,
            reason="",
            used_by_trend=True,
            conditions=tuple(Condition(k, float(v[n])) for k, v in conditions.items()),
        )
        for n, value in enumerate(values)
    ]


def lived(seed, *, drift=0.0, load=0.0, step=0.0):
    """Return a history whose gain ages, depends on the load, and steps at a maintenance."""
    rng = np.random.default_rng([21, seed])
    cycle = np.arange(CYCLES)
    loads = rng.choice([1.0, 2.0, 3.0, 4.0], CYCLES) + 0.1 * rng.standard_normal(CYCLES)
    gain = 1.0 + drift * cycle / CYCLES + load * (loads - 2.5) + step * (cycle >= 40)
    return history(gain + SCATTER * rng.standard_normal(CYCLES), load=loads)


def separated(estimates, *, maintenance=(), **config):
    rules = AgingConfig(**config)
    history = order_history(estimates, Axis.CYCLES)
    return without_conditions(series_of(history, "gain"), history.rows, maintenance, rules)


def trend(estimates, **config):
    return assess(estimates, (), AgingConfig(**config), parameters=PARAMETERS).trends[0]


def test_an_effect_is_found_inside_its_interval_beside_the_drift():
    """95 % intervals of 60 histories: 3 standard deviations of the binomial below nominal."""
    inside = 0
    for seed in range(60):
        _, (effect,) = separated(lived(seed, drift=-0.1, load=-0.02), covariates=("load",))
        assert effect.applied
        inside += abs(effect.slope + 0.02) <= 1.99 * effect.standard_error
    assert inside >= 52


def test_aging_comes_out_of_the_noise_of_the_load():
    worn = lived(1, drift=-0.03, load=-0.04)
    blind, seeing = trend(worn), trend(worn, covariates=("load",))
    assert seeing.status is TrendStatus.DRIFTING
    assert seeing.slope * CYCLES == pytest.approx(-0.03, abs=0.01)
    width, before = (t.prediction_upper_95 - t.prediction_lower_95 for t in (seeing, blind))
    assert width < 0.25 * before
    assert "effect of load taken out (-0.0397 +- " in seeing.reason


def test_a_load_that_is_none_changes_nothing():
    estimates = lived(2, drift=-0.1)
    rng = np.random.default_rng(5)
    other = history([e.value("gain") for e in estimates], load=rng.standard_normal(CYCLES))
    plain, named = trend(other), trend(other, covariates=("load",))
    assert named.slope == plain.slope
    assert "no effect of load (" in named.reason


def test_what_moves_with_time_is_not_taken_for_its_effect():
    """A temperature that only rises and a gain that only falls: nobody can tell."""
    rng = np.random.default_rng(7)
    cycle = np.arange(CYCLES)
    falling = 1.0 - 1e-3 * cycle + SCATTER * rng.standard_normal(CYCLES)
    estimates = history(
        falling, temperature=20.0 + 0.2 * cycle + 0.1 * rng.standard_normal(CYCLES)
    )
    series, (effect,) = separated(estimates, covariates=("temperature",))
    assert not effect.applied
    assert effect.reason == "temperature moves with time as aging does, not taken out"
    assert trend(estimates, covariates=("temperature",)).status is TrendStatus.DRIFTING
    np.testing.assert_array_equal(series.values, falling)


def test_a_step_at_a_maintenance_stays():
    event = Maintenance(41 * 10**9, 41, "new seal")
    estimates = lived(3, load=0.02, step=0.1)
    series, (effect,) = separated(estimates, covariates=("load",), maintenance=(event,))
    assert effect.slope == pytest.approx(0.02, abs=4 * effect.standard_error)
    before, after = series.values[:40].mean(), series.values[40:].mean()
    assert after - before == pytest.approx(0.1, abs=4 * SCATTER / 40**0.5 * 2**0.5)


def test_values_stay_comparable_with_the_reference():
    """What is taken out is relative to the conditions of the first cycles."""
    estimates = lived(4, load=0.05)
    series, _ = separated(estimates, covariates=("load",))
    first = np.median([e.conditions[0].value for e in estimates[:10]])
    assert series.values.mean() == pytest.approx(1.0 + 0.05 * (first - 2.5), abs=0.005)


def test_bins_need_no_line():
    rng = np.random.default_rng(9)
    stroke = rng.choice([0.11, 0.21, 0.31], CYCLES)
    made = {0.11: 0.0, 0.21: 0.1, 0.31: 0.02}
    gain = 1.0 + np.array([made[s] for s in stroke]) + SCATTER * rng.standard_normal(CYCLES)
    estimates = history(gain, stroke=stroke + 0.01 * rng.random(CYCLES))
    series, (effect,) = separated(estimates, binned=("stroke 0.05",))
    assert effect.applied
    assert np.isnan(effect.slope)
    assert effect.span == pytest.approx(0.1, abs=0.01)
    assert series.values.std() < 1.3 * SCATTER
    assert "3 bins" in effect.reason
    line, _ = separated(estimates, covariates=("stroke",))
    assert line.values.std() > 4.0 * SCATTER


def test_a_published_parameter_may_be_named():
    rng = np.random.default_rng(11)
    level = np.arange(CYCLES) % 7
    estimates = history(1.0 + 0.01 * level + SCATTER * rng.standard_normal(CYCLES))
    _, (effect,) = separated(estimates, covariates=("level",))
    assert effect.slope == pytest.approx(0.01, abs=4 * effect.standard_error)


def test_two_conditions_are_told_apart():
    rng = np.random.default_rng(13)
    a, b = rng.standard_normal((2, CYCLES))
    mixed = 0.6 * a + 0.8 * b
    estimates = history(1.0 + 0.02 * a + SCATTER * rng.standard_normal(CYCLES), a=a, b=mixed)
    _, (first, second) = separated(estimates, covariates=("a", "b"))
    assert first.applied
    assert not second.applied
    assert first.slope == pytest.approx(0.02, abs=5 * first.standard_error)


def test_a_condition_that_is_not_known_or_never_changes_is_said():
    estimates = history(np.ones(CYCLES), load=np.full(CYCLES, 3.0))
    series, effects = separated(estimates, covariates=("load", "temperature"))
    reasons = {e.name: e.reason for e in effects}
    assert reasons["load"] == "load never changes"
    assert reasons["temperature"] == f"temperature is known in 0 cycles, {MIN_VALUES} needed"
    assert len(series.values) == CYCLES
    half = np.where(np.arange(CYCLES) % 2, np.nan, 2.0 + np.arange(CYCLES) % 3)
    series, _ = separated(history(np.ones(CYCLES), load=half), covariates=("load",))
    assert len(series.values) == CYCLES // 2
    assert trend([], covariates=("load",)).reason == "no accepted estimate yet"


@pytest.mark.parametrize("text", ["load", "load x", "load 0", " 5", "load -1", "load inf"])
def test_a_bin_without_a_width_is_refused(text):
    with pytest.raises(ValueError, match="write a condition and the width of its bins"):
        AgingConfig(binned=(text,))


def test_a_window_judges_the_effect_by_the_newest_only():
    estimates = lived(5, load=0.02)
    early = history(
        [e.value("gain") + 5.0 for e in estimates[:30]]
        + [e.value("gain") for e in estimates[30:]],
        load=[e.conditions[0].value for e in estimates],
    )
    _, (effect,) = separated(early, covariates=("load",), window=50)
    assert effect.slope == pytest.approx(0.02, abs=4 * effect.standard_error)
    assert effect.standard_error < 1e-3
