# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import itertools
import random
import re
import time
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from valve_twin.core.aging import changepoint, wave
from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig, Axis, Commissioning, Threshold
from valve_twin.core.aging.cutting.ahead import warm_up
from valve_twin.core.aging.laws import shapes
from valve_twin.core.aging.laws.ar1 import ar1_product
from valve_twin.core.aging.verdict import LimitState, Trend, TrendStatus, Verdict, VerdictKind
from valve_twin.core.types import (
    EstimateStatus,
    Maintenance,
    Parameter,
    ParameterStatus,
    ParameterValue,
)

PARAMETERS = [Parameter("K_in", "1", "gain", trend=True), Parameter("leak", "1/s", "leak")]
CONFIG = AgingConfig()
MESSAGES = Path(__file__).parents[3] / "msg_defs" / "msg"


def aging(scatter, n=105, loss=0.15, sd=0.01, seed=0):
    return 0.0098 * (1.0 - loss * np.arange(n) / (n - 1) + sd * scatter(seed, n))


def judge(estimates, maintenance=(), config=CONFIG):
    return assess(estimates, maintenance, config, parameters=PARAMETERS, valve="/press/valve_1")


def trend_of(estimates, maintenance=(), config=CONFIG):
    return judge(estimates, maintenance, config).trends[0]


def same(a, b):
    """Compare results bit by bit; NaN equals NaN."""
    return repr((a.trends, a.verdict)) == repr((b.trends, b.verdict))


@pytest.mark.parametrize(("kind", "name"), [(Trend, "Trend"), (Verdict, "Verdict")])
def test_results_carry_the_fields_of_their_messages(kind, name):
    lines = (MESSAGES / f"{name}.msg").read_text().splitlines()
    words = [line.split("#")[0].split() for line in lines]
    wanted = [w[1] for w in words if len(w) == 2 and "=" not in w[1]]
    alias = {"header": "stamp_ns", "service_date": "service_date_ns"}
    alias |= {"service_date_early": "service_date_early_ns", "verdict": "kind"}
    assert [alias.get(w, w) for w in wanted] == [f.name for f in fields(kind)]


@pytest.mark.parametrize(
    ("kind", "name", "prefix"),
    [(TrendStatus, "Trend", ""), (LimitState, "Trend", "LIMIT_"), (VerdictKind, "Verdict", "")],
)
def test_status_numbers_are_those_of_the_messages(kind, name, prefix):
    lines = (MESSAGES / f"{name}.msg").read_text().splitlines()
    pairs = [
        line.split("#")[0].split()[1].split("=") for line in lines if line.startswith("uint8 ")
    ]
    wanted = {p[0]: int(p[1]) for p in pairs if len(p) == 2}
    own = {name: n for name, n in wanted.items() if name.startswith("LIMIT_") == bool(prefix)}
    assert own == {prefix + k.name: k.value for k in kind}


def test_a_withdrawn_event_begins_no_segment_and_no_reference(history, scatter):
    estimates = history(K_in=aging(scatter))
    event = Maintenance(0, 60, "new cartridge", new_reference=True)
    withdrawn = replace(event, withdrawn=True, withdrawn_note="the other valve was meant")
    kept = Maintenance(0, 20, "seal")
    assert not same(judge(estimates, [kept, event]), judge(estimates, [kept]))
    assert same(judge(estimates, [kept, withdrawn]), judge(estimates, [kept]))


def test_aging_valve_is_called_by_name_with_numbers(history, scatter):
    result = judge(history(K_in=aging(scatter)))
    trend = result.trends[0]
    assert trend.status is TrendStatus.DRIFTING
    assert trend.drift_reference_lower_95 < -14.4 < trend.drift_reference_upper_95
    assert result.verdict.text == "valve"
    assert result.verdict.fault == "K_in"
    words = result.verdict.evidence
    assert words.startswith(f"K_in {trend.drift_reference:+.1f} % of new (95 %: ")
    assert f"{trend.remaining_median:.0f} cycles left" in words


def test_level_intervals_are_nested(history, scatter):
    t = trend_of(history(K_in=aging(scatter)))
    assert (
        t.prediction_lower_95 < t.mean_lower_95 < t.level < t.mean_upper_95 < t.prediction_upper_95
    )
    assert t.slope_lower_95 < t.slope < t.slope_upper_95 < 0.0
    assert t.remaining_low < t.remaining_median < t.remaining_high < np.inf


def test_monitor_that_was_down_says_the_same(history, scatter):
    estimates = history(K_in=aging(scatter))
    events = [Maintenance(0, 60, "spring", new_reference=False), Maintenance(0, 20, "seal")]
    shuffled = estimates[:]
    random.Random(1).shuffle(shuffled)
    foreign = [replace(e, estimator="equation_error_qp4", used_by_trend=False) for e in estimates]
    assert same(judge(estimates, events), judge(foreign + shuffled, events[::-1]))


def test_one_wild_estimate_neither_cuts_nor_alarms(history, scatter):
    clean = 0.0098 * (1.0 + 0.01 * scatter(3, 60))
    for place, size in itertools.product((0, 5, 30, 58, 59), (-0.9, 0.5, 20.0)):
        values = clean.copy()
        values[place] *= 1.0 + size
        result = judge(history(K_in=values))
        assert result.trends[0].segments == 1
        assert result.trends[0].status is TrendStatus.STEADY
        assert result.verdict.kind is VerdictKind.OK
        assert result.details[0].outlier[place]


def test_newest_wild_estimates_are_named(history, scatter):
    values = 0.0098 * (1.0 + 0.01 * scatter(3, 60))
    values[-2:] *= 0.7
    assert "the newest 2 estimates lie off the trend" in trend_of(history(K_in=values)).reason


def test_a_slope_is_told_with_its_unit_where_it_has_one(history, scatter):
    values = aging(scatter, loss=0.15)
    for unit, words in (("1", "per cycle"), ("1/s", "1/s per cycle")):
        parameters = [Parameter("K_in", unit, "gain", trend=True)]
        result = assess(history(K_in=values), (), CONFIG, parameters=parameters)
        assert re.match(rf"slope -\S+ {words} \(p = ", result.trends[0].reason)


def test_maintenance_starts_a_segment_where_none_is_seen(history, scatter):
    estimates = history(K_in=aging(scatter, loss=0.0))
    trend = trend_of(estimates, [Maintenance(0, 81, "seal changed")])
    assert (trend.segments, trend.segment_start, trend.samples) == (2, 81.0, 25)
    assert trend.reference_source == "first_cycles"
    by_stamp = trend_of(estimates, [Maintenance(estimates[80].start_ns, 0, "seal changed")])
    assert by_stamp.segment_start == 81.0


def test_after_maintenance_there_is_not_enough_data_at_first(history, scatter):
    estimates = history(K_in=aging(scatter))
    result = judge(estimates, [Maintenance(0, 106, "new cartridge", new_reference=True)])
    assert result.trends[0].status is TrendStatus.NOT_ENOUGH_DATA
    assert result.trends[0].samples == 0
    assert result.verdict.text == "not enough data"
    assert "0 of 10 estimates since maintenance" in result.verdict.evidence


def test_new_reference_forgets_the_old_drift(history, scatter):
    worn = aging(scatter)
    fresh = 0.0098 * (1.0 + 0.01 * scatter(7, 40))
    estimates = history(K_in=np.concatenate([worn, fresh]))
    trend = trend_of(estimates, [Maintenance(0, 106, "new cartridge", new_reference=True)])
    assert trend.reference == pytest.approx(fresh[:10].mean())
    assert abs(trend.drift_reference) < 1.5
    kept = trend_of(estimates, [Maintenance(0, 106, "cleaned")])
    assert kept.reference == pytest.approx(worn[:10].mean())


def test_commissioning_record_is_the_reference_until_it_is_replaced(history, scatter):
    config = replace(CONFIG, commissioning=(Commissioning("K_in", 0.0110, 1e-5),))
    estimates = history(K_in=aging(scatter))
    result = judge(estimates, config=config)
    trend = result.trends[0]
    assert (trend.reference, trend.reference_source) == (0.0110, "commissioning")
    assert trend.drift_reference == pytest.approx(100.0 * (trend.level / 0.0110 - 1.0))
    assert "of commissioning" in result.verdict.evidence
    renewed = trend_of(estimates, [Maintenance(0, 1, "", new_reference=True)], config)
    assert renewed.reference_source == "first_cycles"


@pytest.mark.no_cover
def test_drift_interval_covers_the_truth(history, scatter):
    true = 100.0 * (0.85 / (1.0 - 0.15 * 4.5 / 104) - 1.0)
    hits = 0
    for seed in range(400):
        t = trend_of(history(K_in=aging(scatter, seed=seed)))
        hits += t.drift_reference_lower_95 <= true <= t.drift_reference_upper_95
    assert 0.92 <= hits / 400 <= 0.98  # binomial standard deviation 1.1 %


def test_drift_since_the_segment_began(history, scatter):
    t = trend_of(history(K_in=aging(scatter)))
    assert t.drift_segment == pytest.approx(-15.0, abs=1.0)
    assert t.drift_segment_lower_95 < -15.0 < t.drift_segment_upper_95


def test_threshold_may_be_relative_or_absolute(history, scatter):
    estimates = history(K_in=aging(scatter))
    relative = trend_of(estimates, config=replace(CONFIG, thresholds=(Threshold("K_in", -30.0),)))
    assert relative.threshold == pytest.approx(0.7 * relative.reference)
    limit = Threshold("K_in", 0.0070, relative=False)
    straight = replace(CONFIG, thresholds=(limit,), laws=("line",))
    absolute = trend_of(estimates, config=straight)
    assert absolute.threshold == 0.0070
    gap = absolute.level - 0.0070
    assert absolute.remaining_median == pytest.approx(gap / -absolute.slope, rel=1e-5)


def test_of_two_thresholds_the_one_ahead_is_reported(history, scatter):
    up = aging(scatter, loss=-0.15)
    assert trend_of(history(K_in=up)).threshold > up.max()
    assert trend_of(history(K_in=aging(scatter))).threshold < up.min()


@pytest.mark.parametrize("loss", [0.25, -0.25])
def test_a_limit_either_way_holds_up_and_down(history, scatter, loss):
    config = replace(CONFIG, thresholds=(Threshold("K_in", 20.0, either_way=True),))
    result = judge(history(K_in=aging(scatter, loss=loss)), config=config)
    assert result.trends[0].status is TrendStatus.BEYOND_THRESHOLD
    assert result.verdict.text == "valve"


def test_an_absolute_limit_has_one_side():
    limit = Threshold("K_in", 0.007, relative=False, either_way=True)
    with pytest.raises(ValueError, match="limit of K_in is absolute"):
        replace(CONFIG, thresholds=(limit,))


def test_without_threshold_nothing_remains_to_be_said(history, scatter):
    config = replace(CONFIG, default_percent=0.0)
    result = judge(history(K_in=aging(scatter)), config=config)
    trend = result.trends[0]
    assert np.isnan(trend.threshold)
    assert trend.unbounded
    assert trend.remaining_low == trend.remaining_median == trend.remaining_high == np.inf
    assert not trend.service_date_known
    assert result.verdict.kind is VerdictKind.OK
    assert "no threshold set" in result.verdict.evidence


def test_beyond_the_threshold(history, scatter):
    result = judge(history(K_in=aging(scatter, loss=0.25)))
    assert result.trends[0].status is TrendStatus.BEYOND_THRESHOLD
    assert result.trends[0].remaining_median == 0.0
    assert result.verdict.text == "valve"
    assert "beyond its threshold" in result.verdict.evidence


def test_small_certain_drift_is_reported_but_raises_no_verdict(history, scatter):
    result = judge(history(K_in=aging(scatter, n=400, loss=0.03, sd=0.005)))
    assert result.trends[0].status is TrendStatus.DRIFTING
    assert result.verdict.kind is VerdictKind.OK
    assert "; largest drift: K_in -" in result.verdict.evidence


def test_fast_drift_raises_the_verdict_before_half_of_the_way(history, scatter):
    values = aging(scatter, n=31, loss=0.08, sd=0.004)
    near, far = (replace(CONFIG, horizon=h) for h in (100.0, 10.0))
    assert judge(history(K_in=values), config=near).verdict.text == "valve"
    assert judge(history(K_in=values), config=far).verdict.text == "ok"


def test_what_was_lost_stays_lost_while_a_segment_is_young(history, scatter):
    """A further step, eight to twenty cycles old, does not make a worn valve a good one."""
    worn = aging(scatter, n=80, loss=0.14, sd=0.004)
    for young in range(8, 21):
        late = worn[-1] * (0.95 + 0.03 * scatter(young, young))
        result = judge(history(K_in=np.concatenate([worn, late])))
        trend = result.trends[0]
        assert trend.status is not TrendStatus.NOT_ENOUGH_DATA
        assert trend.share_lost > CONFIG.alert_fraction
        assert result.verdict.kind is VerdictKind.VALVE


def test_what_came_back_is_not_lost(history, scatter):
    values = np.concatenate([np.ones(40), 0.85 * np.ones(20), np.ones(20)])
    trend = trend_of(history(K_in=values + 0.004 * scatter(1, 80)))
    assert trend.segments == 3
    assert trend.share_lost < 0.1


def test_maintenance_gives_back_what_was_lost(history, scatter):
    worn = aging(scatter, n=80, loss=0.14, sd=0.004)
    fresh = 0.0098 * (1.0 + 0.004 * scatter(3, 20))
    estimates = history(K_in=np.concatenate([worn, fresh]))
    result = judge(estimates, [Maintenance(0, 81, "new seal")])
    assert result.trends[0].share_lost < 0.1
    assert result.verdict.kind is VerdictKind.OK


def test_a_trend_that_bends_is_called_so(history, scatter):
    u = np.arange(1, 101) / 140.0
    noise = 0.004 * scatter(2, 100)
    fast = 1.0 - 0.2 * np.expm1(3.0 * u) / np.expm1(3.0)
    result = judge(history(K_in=fast + noise))
    trend = result.trends[0]
    assert trend.bends
    assert trend.segments == 1
    assert trend.remaining_low < 39.0 < trend.remaining_high  # cycle 140, counted from new
    assert f"the trend bends ({trend.law})" in result.verdict.evidence
    slow = 1.0 - 0.16 * np.expm1(-4.0 * u) / np.expm1(-4.0)
    settled = trend_of(history(K_in=slow + noise))
    assert (settled.law, settled.bends, settled.unbounded) == ("saturating", True, True)
    assert "no forecast: the trend bends (saturating)" in settled.reason


def test_laws_may_be_limited_to_a_line(history, scatter):
    u = np.arange(1, 101) / 140.0
    fast = 1.0 - 0.2 * np.expm1(3.0 * u) / np.expm1(3.0) + 0.004 * scatter(2, 100)
    trend = trend_of(history(K_in=fast), config=replace(CONFIG, laws=("line",)))
    assert (trend.law, trend.law_probability, trend.bends) == ("line", 1.0, False)


def test_probability_before_the_next_stop(history, scatter):
    estimates = history(K_in=aging(scatter))
    told = trend_of(estimates)
    assert np.isnan(told.next_stop_probability)
    ahead = [
        trend_of(estimates, config=replace(CONFIG, next_stop=f"{n:.9g}")).next_stop_probability
        for n in (1.0, told.remaining_low, told.remaining_median, told.remaining_high)
    ]
    assert ahead[0] < 0.001
    assert ahead[1:] == pytest.approx([0.025, 0.5, 0.975], abs=2e-3)


def test_next_stop_may_be_a_date(history, scatter):
    estimates = history(K_in=aging(scatter))
    told = trend_of(estimates)
    date = np.datetime64(told.service_date_ns // 10**9, "s")
    trend = trend_of(estimates, config=replace(CONFIG, next_stop=str(date)))
    assert trend.next_stop_probability == pytest.approx(0.5, abs=0.01)


def test_step_is_found_and_not_called_a_slope(history, scatter):
    step = np.where(np.arange(105) >= 50, 0.85, 1.0) + 0.01 * scatter(1, 105)
    result = judge(history(K_in=0.0098 * step))
    trend = result.trends[0]
    assert (trend.status, trend.segments) == (TrendStatus.STEADY, 2)
    assert trend.segment_start == 51.0
    assert trend.drift_reference == pytest.approx(-15.0, abs=1.5)
    assert result.verdict.text == "valve"


@pytest.mark.parametrize("n", [0, 1, 2, 9])
def test_few_estimates_are_not_enough(n, history, scatter):
    estimates = history(K_in=aging(scatter))[:n]
    result = judge(estimates)
    assert result.trends[0].status is TrendStatus.NOT_ENOUGH_DATA
    assert result.verdict.text == ("no reference" if n else "not enough data")
    assert result.verdict.cycle == n
    reason = f"{n} of 10 estimates" if n else "no accepted estimate yet"
    assert reason in result.verdict.evidence


def test_refused_values_count_on_the_axis_only(history, scatter):
    estimates = history(K_in=aging(scatter), leak=np.ones(105))
    bad = ParameterValue("K_in", np.nan, ParameterStatus.NOT_EXCITED)
    bound = ParameterValue("K_in", 99.0, ParameterStatus.AT_BOUND)
    leak = estimates[0].parameters[1]
    estimates[40] = replace(estimates[40], parameters=(bad, leak), status=EstimateStatus.PARTIAL)
    estimates[50] = replace(estimates[50], parameters=(bound, leak))
    estimates[60] = replace(estimates[60], status=EstimateStatus.REFUSED)
    trend = trend_of(estimates)
    assert (trend.samples, trend.axis_value) == (102, 105.0)
    both = judge(estimates, config=replace(CONFIG, parameters=("leak", "K_in")))
    assert [t.samples for t in both.trends] == [104, 102]
    assert both.trends[0].status is TrendStatus.STEADY


def test_what_remains_counts_from_the_newest_cycle_with_or_without_an_estimate(history, scatter):
    estimates = history(K_in=aging(scatter))
    refused = [replace(e, status=EstimateStatus.REFUSED) for e in estimates[-6:]]
    before = trend_of(estimates[:-6])
    config = replace(CONFIG, next_stop=repr(before.remaining_median - 6.0))
    now = trend_of([*estimates[:-6], *refused], config=config)
    assert (now.samples, now.level) == (before.samples, before.level)
    for name in ("remaining_low", "remaining_median", "remaining_high"):
        assert getattr(now, name) == pytest.approx(getattr(before, name) - 6.0, abs=0.02)
    assert now.service_date_ns == pytest.approx(before.service_date_ns, abs=10**9)
    assert now.next_stop_probability == pytest.approx(0.5, abs=0.01)


def test_odd_values_are_answered_without_a_fault(history):
    rng = np.random.default_rng(0)
    oddities = (
        np.zeros(60),
        np.full(60, 1e49),
        1e-300 * rng.standard_normal(60),
        1e3 * rng.standard_cauchy(60),
        rng.choice([0.0, 1.0], 60),
        np.exp(np.arange(60.0)),
        np.full(60, 1e300),
    )
    status = [trend_of(history(K_in=values)).status for values in oddities]
    assert status[:2] == [TrendStatus.STEADY, TrendStatus.STEADY]
    assert status[-1] is TrendStatus.NOT_ENOUGH_DATA  # no parameter is as large


def test_known_missed_cycles_stretch_the_axis(history, scatter):
    estimates = history(K_in=aging(scatter))
    estimates = [
        replace(e, cycle=e.cycle + 100 * (e.cycle > 50), missed_cycles=100 * (e.cycle == 51))
        for e in estimates
    ]
    trend = trend_of(estimates)
    assert trend.axis_value == 205.0
    assert "unknown" not in trend.reason


def test_unknown_missed_cycles_are_named_and_not_invented(history, scatter):
    estimates = history(K_in=aging(scatter))
    estimates[50] = replace(estimates[50], missed_cycles=-1, status=EstimateStatus.REFUSED)
    trend = trend_of(estimates)
    assert trend.axis_value == 105.0
    assert "1 breaks with unknown missed cycles" in trend.reason


def test_counter_that_starts_again_goes_on_counting(history, scatter):
    estimates = history(K_in=aging(scatter))
    estimates = [replace(e, cycle=e.cycle - 60 * (e.cycle > 60)) for e in estimates]
    trend = trend_of(estimates, config=replace(CONFIG, axis=Axis.COUNTER))
    assert (trend.axis, trend.axis_value) == ("counter", 105.0)
    assert "unknown missed cycles" in trend.reason


def test_a_clock_that_is_set_back_does_not_mix_the_cycles(history, scatter):
    """A simulation started again, a bag played twice: numbers go on, stamps begin anew."""
    estimates = history(K_in=aging(scatter))
    back = 59 * 30_000_000_000
    moved = [
        replace(
            e, start_ns=e.start_ns - back, end_ns=e.end_ns - back, missed_cycles=-(e.cycle == 61)
        )
        if e.cycle > 60
        else e
        for e in estimates
    ]
    expected, trend = trend_of(estimates), trend_of(moved)
    assert trend.axis_value == 105.0
    assert (trend.level, trend.slope) == (expected.level, expected.slope)
    assert trend.cycle_rate == pytest.approx(1 / 30.0)


def test_cycles_that_differ_by_something_else_give_no_verdict(history, scatter):
    label = "by load at equal stroke, not aging"
    config = replace(CONFIG, label=label)
    found = judge(history(K_in=aging(scatter)), (), config)
    assert found.verdict.kind is VerdictKind.NOT_ENOUGH_DATA
    assert label in found.verdict.evidence
    assert all(label in trend.reason for trend in found.trends)


def test_hours_come_from_the_stamps(history, scatter):
    estimates = history(K_in=aging(scatter))
    cycles = trend_of(estimates)
    hours = trend_of(estimates, config=replace(CONFIG, axis=Axis.HOURS))
    assert hours.axis_value == pytest.approx(104 * 30.0 / 3600.0)
    assert hours.cycle_rate == pytest.approx(1 / 3600.0)
    assert hours.remaining_median == pytest.approx(cycles.remaining_median * 30.0 / 3600.0)
    assert hours.service_date_ns == pytest.approx(cycles.service_date_ns, abs=1e6)


@pytest.mark.parametrize("alike", [6, 1000])
def test_hours_where_cycles_end_at_the_same_time(alike, history, scatter):
    estimates = history(K_in=0.02 * (1.0 + 0.01 * scatter(22, 120)))
    ends = [e.end_ns // (alike * 30 * 10**9) * 10**9 for e in estimates]
    estimates = [replace(e, end_ns=end) for e, end in zip(estimates, ends, strict=True)]
    trend = trend_of(estimates, config=replace(CONFIG, axis=Axis.HOURS))
    assert trend.samples == 120
    assert trend.status is TrendStatus.STEADY


def test_service_date_from_the_recent_rate(history, scatter):
    estimates = history(K_in=aging(scatter))
    t = trend_of(estimates)
    assert t.cycle_rate == pytest.approx(1 / 30.0)
    assert t.service_date_known
    assert t.service_date_ns == pytest.approx(t.stamp_ns + t.remaining_median * 30e9, abs=1e6)
    assert t.stamp_ns < t.service_date_early_ns < t.service_date_ns


def test_no_service_date_without_a_bounded_life(history, scatter):
    result = judge(history(K_in=aging(scatter, loss=0.0)))
    t = result.trends[0]
    assert t.unbounded
    assert f"no forecast yet, not before {t.remaining_low:.0f} cycles" in result.verdict.evidence
    assert not t.service_date_known
    assert t.service_date_ns == t.service_date_early_ns == 0


def test_window_bounds_the_past_but_keeps_the_reference(history, scatter):
    values = aging(scatter, n=300)
    trend = trend_of(history(K_in=values), config=replace(CONFIG, window=100))
    assert (trend.samples, trend.segment_start) == (100, 201.0)
    assert trend.reference == pytest.approx(values[:10].mean())


def test_parameter_around_zero_has_no_relative_drift(history, scatter):
    config = replace(CONFIG, parameters=("leak",))
    result = judge(history(leak=1e-4 * scatter(1, 80)), config=config)
    trend = result.trends[0]
    assert np.isnan(trend.drift_reference)
    assert np.isnan(trend.threshold)
    assert trend.unit == "1/s"
    assert "leak" in result.verdict.evidence


def test_negative_parameter_loses_percent_of_its_size(history, scatter):
    t = trend_of(history(K_in=-aging(scatter)))
    assert t.drift_reference == pytest.approx(-14.4, abs=1.0)
    assert t.threshold == pytest.approx(0.8 * t.reference)
    assert t.remaining_median < 80.0


def test_details_give_every_line_for_plots(history, scatter):
    step = np.where(np.arange(80) >= 40, 0.9, 1.0) + 0.01 * scatter(1, 80)
    detail = judge(history(K_in=step)).details[0]
    assert list(detail.starts) == [0, 40]
    assert [line.samples for line in detail.lines] == [40, 40]
    assert detail.lines[0].level(20.0) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"min_segment": 2}, r"AgingConfig.min_segment = 2: must be a number, 4 or more \[1\]"),
        (
            {"significance": 0.0},
            r"AgingConfig.significance = 0.0: must be a number from 1e-09 to 1 \[1\]",
        ),
        ({"horizon": float("nan")}, "AgingConfig.horizon = nan: must be a number, 0 or more"),
        ({"next_stop": "soon"}, 'next_stop is "soon": write how many cycles'),
        ({"next_stop": "-5"}, 'next_stop is "-5": write how many cycles'),
        ({"commissioning": (Commissioning("K_in", float("inf")),)}, "record of K_in is inf"),
    ],
)
def test_config_that_cannot_work_is_refused(change, words):
    with pytest.raises(ValueError, match=words):
        AgingConfig(**change)


def test_thousand_cycles_of_four_parameters_cost_less_than_six_million_additions(history, scatter):
    columns = {f"p{k}": aging(scatter, n=1000, seed=k) for k in range(4)}
    estimates = history(**columns)
    parameters = [Parameter(name, "1", "", trend=True) for name in columns]
    ours = cpu_time_s(lambda: assess(estimates, [], CONFIG, parameters=parameters))
    assert ours < 6.0 * cpu_time_s(lambda: sum(range(1_000_000)))


def cpu_time_s(action) -> float:
    """Return the least CPU time of seven calls after a first one."""
    action()
    took = []
    for _ in range(7):
        begin = time.process_time()
        action()
        took.append(time.process_time() - begin)
    return min(took)


def test_warm_up_leaves_nothing_to_compile(history, scatter):
    warm_up()
    kernels: tuple[Any, ...] = (
        changepoint._repeated_median,
        changepoint._sums,
        changepoint._partition,
        changepoint._refine,
        changepoint._off_lines,
        ar1_product,
        shapes.curves,
        shapes.squares,
        shapes.whitened,
        wave._search,
    )
    compiled = [len(k.signatures) for k in kernels]
    assert all(compiled)
    estimates = history(K_in=aging(scatter, n=700))
    judge(estimates, [Maintenance(0, 300, "seal")])
    cycle = np.arange(120.0)
    toothed = 1.0 - 1e-3 * cycle + 5e-4 * (cycle % 20.0) + 2e-4 * scatter(0, 120)
    assert "that repeats every" in trend_of(history(K_in=toothed)).reason
    assert [len(k.signatures) for k in kernels] == compiled
