# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""When a remaining life has an upper limit, and how wide it is."""

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.aging.limits.forecast import FOUND_SAMPLES, SCALE
from valve_twin.core.aging.verdict import LimitState, TrendStatus
from valve_twin.core.types import Parameter

PARAMETERS = (Parameter("K_in", "1", "gain", trend=True),)
LINE = AgingConfig(laws=("line",))


def trend_of(estimates, config=LINE):
    return assess(estimates, (), config, parameters=PARAMETERS).trends[0]


def known_to(estimates, share):
    """Return the estimates with limits that hold a systematic error of a share of the value."""

    def limits(p):
        half = 1.96 * share * p.value
        return replace(p, standard_error=0.0, lower_95=p.value - half, upper_95=p.value + half)

    return [replace(e, parameters=tuple(limits(p) for p in e.parameters)) for e in estimates]


def test_a_slope_that_hundreds_of_looks_may_show_by_chance_leads_to_no_limit(history, scatter):
    noise = 0.01 * scatter(11, 40)
    slope = np.linspace(0.0, 1.0, 40)
    told = [trend_of(history(K_in=1.0 - loss * slope + noise)) for loss in (0.015, 0.08)]
    assert 0.002 < told[0].p_value < 0.01
    assert told[0].status is TrendStatus.DRIFTING
    assert [t.unbounded for t in told] == [True, False]


def test_a_short_segment_behind_a_jump_leads_to_no_limit(history, scatter):
    n = 60 + FOUND_SAMPLES
    k = np.arange(n)
    values = np.where(k < 60, 1.0, 0.95 - 0.002 * (k - 60)) + 0.001 * scatter(4, n)
    short, long = (trend_of(history(K_in=values[:m])) for m in (n - 1, n))
    assert (short.segments, long.segments) == (2, 2)
    assert short.p_value < 1e-9
    assert (short.unbounded, long.unbounded) == (True, False)


def test_a_level_past_its_limit_but_not_beyond_doubt_has_no_finite_life(history, scatter):
    values = 1.0 - 0.3 * np.arange(40) / 39.0 + 0.002 * scatter(5, 40)
    estimates = history(K_in=values)
    doubtful, sure = (trend_of(known_to(estimates, share)) for share in (0.14, 0.01))
    assert doubtful.drift_reference_upper_95 < 0.0
    assert doubtful.status is sure.status is TrendStatus.BEYOND_THRESHOLD
    assert (doubtful.limit_state, sure.limit_state) == (LimitState.NONE, LimitState.ALARM)
    assert (doubtful.unbounded, sure.unbounded) == (True, False)


def test_the_scale_of_a_drift_is_as_uncertain_as_strangers_show(history, scatter):
    values = 1.0 - 0.002 * np.arange(1, 51) + 1e-5 * scatter(6, 50)
    bare = trend_of(history(K_in=values))
    known = trend_of(known_to(history(K_in=values), 1e-5))
    ahead = 0.2 * bare.reference / 0.002  # cycles that the whole way takes
    gone = ahead - bare.remaining_median
    doubt = 2.01 * SCALE  # quantile of Student's t for 48 degrees of freedom
    assert bare.remaining_high - bare.remaining_low < 0.2
    assert known.remaining_median == pytest.approx(bare.remaining_median, abs=0.1)
    assert known.remaining_low == pytest.approx(ahead / (1.0 + doubt) - gone, abs=0.5)
    assert known.remaining_high == pytest.approx(ahead / (1.0 - doubt) - gone, abs=0.5)
    assert known.drift_reference_lower_95 == pytest.approx(bare.drift_reference_lower_95, abs=0.01)


def test_scatter_alone_is_not_likely_to_reach_a_limit_before_the_next_stop(history, scatter):
    config = AgingConfig(next_stop="30")
    told = [
        trend_of(history(K_in=1.0 + 0.1 * scatter(seed, 30)), config).next_stop_probability
        for seed in range(20)
    ]
    # the laws alone, which take a drift for granted, say 0.28
    assert np.mean(told) < 0.15
