# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is said about one valve at one time does not contradict itself, whatever its history."""

import math
from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.aging.assess import Assessment, assess
from valve_twin.core.aging.config import AgingConfig, Threshold
from valve_twin.core.aging.verdict import (
    Outlook,
    TrendStatus,
    VerdictKind,
    concern,
    decide,
    describe_limit,
    outlook,
    unjudged,
)
from valve_twin.core.diagnosis.changes.finding import FRESH, Diagnosis, Finding, Stale
from valve_twin.core.faults.advice import NONE, NOW, advise
from valve_twin.core.faults.ne107 import Ne107
from valve_twin.core.types import Parameter

PARAMETERS = [Parameter("K_in", "1", "gain", trend=True)]


def random_history(seed, history, scatter):
    """Return a history and a configuration: any law, scatter, limit; most are no valve's."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(10, 150))
    x, change = np.arange(n) / n, rng.uniform(-0.3, 0.3)
    law = np.stack([0.0 * x, x, x**3, x > rng.uniform(0.1, 0.9)])[int(rng.integers(4))]
    noise = 10.0 ** rng.uniform(-3.5, -1.2) * scatter(seed, n, rng.uniform(0.0, 0.8))
    relative = Threshold("K_in", float(rng.choice([-20.0, -5.0, -1.0, 5.0, 10.0])))
    itself = Threshold("K_in", float(rng.uniform(0.8, 1.2)), relative=False)
    limits = [(), (relative,), (itself,)][int(rng.integers(3))]
    return history(K_in=1.0 + change * law + noise), AgingConfig(thresholds=limits)


@pytest.fixture(scope="module")
def told(history, scatter):
    """Return configuration, trend, verdict of 300 random histories."""
    found = []
    for seed in range(50_000, 50_300):
        estimates, config = random_history(seed, history, scatter)
        result = assess(estimates, (), config, parameters=PARAMETERS)
        found.append((config, result.trends[0], result.verdict))
    return found


@pytest.mark.no_cover
def test_every_word_and_every_outlook_occurs(told):
    """Else the properties below would hold of nothing."""
    kinds = [verdict.kind for _, _, verdict in told]
    assert min(map(kinds.count, (VerdictKind.OK, VerdictKind.VALVE))) > 50
    assert kinds.count(VerdictKind.NOT_ENOUGH_DATA) > 5
    seen = [outlook(trend) for _, trend, _ in told]
    assert set(seen) == set(Outlook)


def test_ok_names_no_limit_that_is_or_may_be_reached(told):
    for config, trend, verdict in told:
        if verdict.kind is not VerdictKind.OK:
            continue
        assert trend.status is not TrendStatus.BEYOND_THRESHOLD
        assert not concern(trend, config)
        assert "beyond its" not in verdict.evidence
        assert not outlook(trend).says_when or trend.remaining_low >= 1.0
        assert not trend.service_date_known or trend.remaining_low >= 1.0


def test_ok_names_each_parameter_of_which_it_says_nothing(history, scatter):
    """It was said with a leak of -218 .. +291 % and for parameters that have no estimates."""
    n, names = 30, ("K_in", "leak", "lag")
    config = AgingConfig(thresholds=tuple(Threshold(name, 20.0) for name in names))
    estimates = history(
        K_in=1.0 + np.linspace(0.0, 0.06, n) + 1e-3 * scatter(4, n, 0.0),
        leak=1.0 + 0.3 * scatter(9, n, 0.0),
        lag=np.where(np.arange(n) < 5, 1.0, np.nan),
    )
    parameters = [Parameter(name, "1", "", trend=True) for name in names]
    alone = assess(estimates, (), config, parameters=parameters[:1]).verdict
    found = assess(estimates, (), config, parameters=parameters)
    assert alone.kind is found.verdict.kind is VerdictKind.OK
    assert not any(text in alone.evidence for text in ("nothing is said", "within the doubt: "))
    leak = found.trends[1]
    told = f"{leak.drift_reference_lower_95:+.1f} .. {leak.drift_reference_upper_95:+.1f} of +20 %"
    assert leak.drift_reference_upper_95 > 20.0
    begin = (
        f"a limit of leak is within the doubt: {told}; nothing is said of lag: 5 of 10 estimates"
    )
    assert found.verdict.evidence.startswith(begin)
    assert "; unchanged since cycle 1" in found.verdict.evidence
    assert unjudged(found.verdict, found.trends) == ("leak", "lag")
    assert unjudged(alone, found.trends[:1]) == ()


def sided(names):
    """Return parameters whose directions have nothing to do with their names."""
    sides = {"up": "2", "down": "1"}
    pairs = [name.split("_") for name in names]
    return [
        Parameter(n, "1", "", trend=True, sided=(pair[0], sides[pair[1]]) if pair[1:] else ())
        for n, pair in zip(names, pairs, strict=True)
    ]


@pytest.mark.parametrize(("names", "ok"), [
    (("rate_up", "rate_down", "slew_up", "slew_down"), False),
    (("rate_up", "rate_down"), False),
    (("slew_up", "rate_down", "slew_down", "lag"), False),
    (("slew_up", "rate_down"), True),  # another parameter: no direction
    (("lag", "rate_down"), True),
])  # fmt: skip
def test_ok_is_not_said_where_no_cycle_tells_anything_of_a_direction(history, scatter, names, ok):
    """It was for 30 cycles in which the opening took ever longer."""
    n = 30
    silent = np.full(n, np.nan)
    columns = {x: 1.0 + 1e-3 * scatter(4, n, 0.0) if "down" in x else silent for x in names}
    config = AgingConfig(thresholds=tuple(Threshold(name, 20.0) for name in names))
    said = assess(history(**columns), (), config, parameters=sided(names)).verdict
    assert said.kind is (VerdictKind.OK if ok else VerdictKind.NOT_ENOUGH_DATA)
    mute = ", ".join(x for x in names if x.endswith("_up"))
    told = f"one direction is not judged, no cycle told {mute}"
    assert said.evidence.startswith(told) is not ok


def test_ok_is_said_where_one_parameter_of_a_direction_tells_of_it(history, scatter):
    names, n = ("rate_up", "rate_down", "slew_up", "slew_down"), 30
    columns = {x: 1.0 + 1e-3 * scatter(i, n, 0.0) for i, x in enumerate(names)}
    columns["slew_up"][:] = np.nan
    config = AgingConfig(thresholds=tuple(Threshold(name, 20.0) for name in names))
    said = assess(history(**columns), (), config, parameters=sided(names)).verdict
    assert said.kind is VerdictKind.OK


@pytest.mark.parametrize(("reach", "kind"), [
    ((-5.0, 80.0), VerdictKind.NOT_ENOUGH_DATA), ((-15.0, 80.0), VerdictKind.OK),
])  # fmt: skip
def test_ok_is_not_said_where_a_limit_seems_to_be_passed(told, reach, kind):
    """It was with a leak of +47.7 % (-0.9 .. +151.9) whose limit is 20 %."""
    trend = next(t for _, t, v in told if t.status is TrendStatus.STEADY and not v.fault)
    passed = replace(
        trend, reference=1.0, threshold=1.2, drift_reference=30.0,
        drift_reference_lower_95=reach[0], drift_reference_upper_95=reach[1],
    )  # fmt: skip
    said = decide([passed], AgingConfig(), valve="", stamp_ns=0, cycle=40)
    assert said.kind is kind
    assert said.evidence.startswith("perhaps beyond a limit: K_in +30.0 %") is (kind.value == 0)


def test_nothing_is_said_to_last_for_no_time(told):
    for _, trend, verdict in told:
        assert "not before 0" not in verdict.evidence
        said = outlook(trend)
        if said is Outlook.REACHED:
            assert trend.remaining_median == 0.0
        elif said is Outlook.FORECAST:
            assert 0.0 <= trend.remaining_low <= trend.remaining_median <= trend.remaining_high
            assert math.isfinite(trend.remaining_high)
        else:
            assert not trend.service_date_known


def test_a_limit_is_reached_where_the_status_says_so_and_nowhere_else(told):
    for _, trend, verdict in told:
        reached = trend.status is TrendStatus.BEYOND_THRESHOLD
        assert reached == (outlook(trend) is Outlook.REACHED)
        assert reached or "beyond its threshold" not in f"{trend.reason} {verdict.evidence}"


def test_advice_follows_the_verdict(told):
    """Good and nothing to do where all is well; now where a limit is passed beyond doubt."""
    for config, trend, verdict in told:
        advice = advise(verdict, [trend])
        well = verdict.kind is VerdictKind.OK
        assert well == (advice.ne107 is Ne107.GOOD) == (not advice.action)
        if well:
            assert advice.urgency == NONE
        if verdict.kind is VerdictKind.VALVE:
            assert (advice.urgency == NOW) == (concern(trend, config) == 3)


def test_the_limit_that_is_in_doubt_is_named_beside_a_life(told):
    words = {(describe_limit(trend), outlook(trend)) for _, trend, _ in told}
    assert ("warning in doubt", Outlook.FORECAST) in words
    for said, ahead in words:
        assert (said == "") == (ahead in (Outlook.UNKNOWN, Outlook.NO_LIMIT))
        assert said != "alarm in doubt" or ahead is Outlook.REACHED
        assert said != "warning in doubt" or ahead is not Outlook.REACHED


def finding(name, alarm):
    return Finding(name, (), "sensor", 3e-4, 20.0, 1, alarm)


def said_of(fault, stale=FRESH):
    return decide([], AgingConfig(), valve="", stamp_ns=0, cycle=40, fault=fault, stale=stale)


def test_clocks_apart_name_no_part():
    said = said_of(finding("clock", 20))
    assert (said.kind, said.fault) == (VerdictKind.RECORDING_UNUSABLE, "clock")
    assert said.evidence.startswith("clocks of position and commands apart, by 300 ppm")
    assert said_of(finding("sensor_offset", 20)).kind is VerdictKind.SENSOR


def test_a_fault_of_before_is_no_verdict_where_the_signals_are_unusable_since():
    """Nothing tells whether it is over (stranger 98214)."""
    stale = Stale("the newest 9 cycles gave no estimate: why", unusable=True, since=32)
    said = said_of(finding("sensor_offset", 20), stale)
    assert said.kind is VerdictKind.RECORDING_UNUSABLE
    assert said.evidence.startswith(f"{stale.reason}; before it offset of the position sensor")
    assert said_of(finding("sensor_offset", 32), stale).kind is VerdictKind.SENSOR
    quiet = replace(stale, unusable=False)
    assert said_of(finding("sensor_offset", 20), quiet).kind is VerdictKind.SENSOR


def named_by(fault, stale=FRESH):
    diagnosis = Diagnosis((fault,), 40, ready=True)
    return Assessment((), said_of(fault, stale), (), diagnosis).named


def test_a_fault_is_named_where_the_verdict_names_its_part():
    stale = Stale("the newest 9 cycles gave no estimate: why", unusable=True, since=32)
    offset = finding("sensor_offset", 20)
    assert named_by(offset) is offset
    assert named_by(offset, stale) is None
    assert named_by(finding("clock", 20)) is None
    worn = replace(said_of(None), kind=VerdictKind.VALVE, fault="K_in")
    assert Assessment((), worn, (), Diagnosis((), 40, ready=True)).named is None
