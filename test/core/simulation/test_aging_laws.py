# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import math

import pytest

from valve_twin.core.simulation.aging_laws import AgingRule


@pytest.mark.parametrize(
    ("law", "rate", "factors"),
    [
        ("none", -0.1, [1.0, 1.0, 1.0, 1.0]),
        ("linear", -0.1, [1.0, 0.9, 0.8, 0.7]),
        ("exponential", -0.1, [1.0, 0.9, 0.81, 0.729]),
        ("step", -0.1, [1.0, 0.9, 0.9, 0.9]),
    ],
)
def test_law_acts_from_its_first_cycle_on(law, rate, factors):
    rule = AgingRule("area_in", law, rate, start_cycle=430)
    assert [rule.factor(c) for c in (429, 430, 431, 432)] == pytest.approx(factors, rel=1e-15)


def test_factor_never_turns_negative_or_infinite():
    assert AgingRule("area_in", "linear", -0.1).factor(1000) == 0.0
    assert math.isfinite(AgingRule("leak", "exponential", 1.0).factor(10**9))


def test_refuses_a_negative_start_cycle():
    with pytest.raises(ValueError, match="start_cycle = -1: must not be negative"):
        AgingRule("area_in", "linear", 0.1, -1)


@pytest.mark.parametrize(
    ("law", "rate", "text"),
    [
        ("liner", 0.1, "law = 'liner': must be one of none, linear, exponential, step"),
        ("linear", math.nan, "rate = nan"),
        ("linear", -1.0, "rate = -1.0: must be between -1 and 10"),
    ],
)
def test_refuses_an_unknown_law_or_rate_with_the_parameter(law, rate, text):
    with pytest.raises(ValueError, match=f"aging of area_in: {text}"):
        AgingRule("area_in", law, rate)
