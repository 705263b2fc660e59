# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Two estimators of one cycle: how far apart, and which one feeds the trend and why."""

import math

import numpy as np
import pytest

from test.core.valves.press_cartridge.generator import Truth, generate_cycle
from valve_twin.core.estimation.cycle.comparison import compare_estimators
from valve_twin.core.estimation.cycle.memory import Memory, memory_from_history
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.types import Cycle, Estimate, EstimateStatus, ParameterStatus, ParameterValue
from valve_twin.core.valves.press_cartridge import MODEL
from valve_twin.core.valves.registry import complete_options

NAN = math.nan


def estimate(estimator, *parameters, cycle=1):
    return Estimate(
        "press_cartridge",
        estimator,
        cycle,
        cycle,
        cycle + 1,
        parameters,
        EstimateStatus.ACCEPTED,
        "",
    )


def compared(*estimates, earlier=()):
    return compare_estimators(
        estimates, earlier, trend_estimator="output_error", trended=("K_in", "leak")
    )


def test_disagreement_is_in_standard_errors_of_both():
    first, second = compared(
        estimate("output_error", ParameterValue("K_in", 1.2, standard_error=0.03)),
        estimate("kalman", ParameterValue("K_in", 1.0, standard_error=0.04)),
    )
    (found,), (back,) = first.disagreements, second.disagreements
    assert (found.estimator, found.parameter) == ("kalman", "K_in")
    assert found.difference == pytest.approx(0.2)
    assert found.standard_errors == pytest.approx(4.0)
    assert (back.estimator, back.standard_errors) == ("output_error", -found.standard_errors)


def test_only_usable_parameters_of_both_are_compared():
    first, _ = compared(
        estimate(
            "output_error",
            ParameterValue("K_in", 1.0),
            ParameterValue("leak", 0.0, ParameterStatus.AT_BOUND),
            ParameterValue("pole", 0.2, standard_error=0.1),
        ),
        estimate(
            "kalman",
            ParameterValue("K_in", 2.0),
            ParameterValue("leak", 1.0, standard_error=0.1),
            ParameterValue("noise_ratio", 0.1),
        ),
    )
    (found,) = first.disagreements
    assert found.difference == -1.0
    assert math.isnan(found.standard_errors)  # neither interval is calibrated


def test_an_estimator_alone_has_nothing_to_be_compared_with():
    (only,) = compared(estimate("output_error", ParameterValue("K_in", 1.0)))
    assert (only.trend_reason, only.disagreements) == ("", ())


def test_the_reason_names_the_scatter_of_both():
    rng = np.random.default_rng(1)
    earlier = [
        estimate(name, ParameterValue("K_in", 1.0 + s * rng.standard_normal()), cycle=n)
        for n in range(40)
        for name, s in (("output_error", 0.01), ("kalman", 0.03))
    ]
    now = [estimate(name, ParameterValue("K_in", 1.0)) for name in ("kalman", "output_error")]
    reason = compared(*now, earlier=earlier)[0].trend_reason
    rule, scatter = reason.split("; scatter between cycles: ")
    assert rule.startswith("output_error always feeds the trend")
    words = scatter.replace(",", "").split()
    assert (words[0], words[1], words[4]) == ("K_in", "output_error", "kalman")
    assert float(words[2]) == pytest.approx(1.0, rel=0.4)
    assert float(words[5]) == pytest.approx(3.0, rel=0.4)
    assert compared(*now, earlier=earlier[:8])[0].trend_reason == rule


def test_every_cycle_says_how_its_estimators_agree_and_the_memory_stays_lean():
    options = complete_options(MODEL, {})
    memory = Memory.empty()
    history: list[Estimate] = []
    for number in range(1, 14):
        made = generate_cycle(Truth(), np.random.default_rng([5, number])).frames
        done, memory = estimate_cycle(MODEL, options, Cycle(number, 0.03, made), memory)
        history.extend(done)
    feeding, beside = done[0], done[1]
    assert (feeding.estimator, beside.estimator) == ("output_error", "kalman")
    both = {d.parameter: d for d in feeding.disagreements if d.estimator == "kalman"}
    assert {"K_in", "K_out", "leak"} <= set(both)
    apart = feeding.value("K_in") - beside.value("K_in")
    assert both["K_in"].difference == apart
    assert abs(both["K_in"].standard_errors) < 4.0
    assert "K_in output_error" in feeding.trend_reason
    assert feeding.trend_reason == beside.trend_reason
    stroke = feeding.conditions[0]
    assert [c.name for c in feeding.conditions] == ["stroke", "moves", "travel"]
    assert stroke.name == "stroke"
    assert stroke.value == pytest.approx(0.28, abs=0.02)
    assert not any(e.disagreements or e.guards or e.conditions for e in memory.estimates)
    assert repr(memory_from_history(history)) == repr(memory)
