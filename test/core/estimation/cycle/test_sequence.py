# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Estimation from cycle to cycle: memory, the model in force, errors and intervals."""

from dataclasses import replace

import numpy as np
import pytest

from test.core.valves.press_cartridge.generator import Truth, generate_cycle
from valve_twin.core.diagnosis.features import NEXT_CYCLE
from valve_twin.core.estimation.cycle.memory import (
    MEMORY_CYCLES,
    Memory,
    memory_from_history,
    model_in_force,
)
from valve_twin.core.estimation.cycle.scatter import MIN_CYCLES, scatter_between_cycles
from valve_twin.core.estimation.cycle.sequence import estimate_cycle, evaluate
from valve_twin.core.types import Cycle, EstimateStatus, ParameterStatus, ParameterValue
from valve_twin.core.valves.press_cartridge import MODEL
from valve_twin.core.valves.registry import complete_options

PERIOD_S = 0.03
OPTIONS = complete_options(MODEL, {})
CYCLES = MEMORY_CYCLES + 6


def cycle_of(number, truth=None):
    rng = np.random.default_rng([21, number])
    return generate_cycle(truth or Truth(), rng, number=number, start_ns=number * 25_500_000_000)


def run(cycles, memory=None):
    memory = memory or Memory.empty()
    history, memories = [], []
    for cycle in cycles:
        estimates, memory = estimate_cycle(MODEL, OPTIONS, cycle, memory)
        history.append(estimates)
        memories.append(memory)
    return history, memories


def bad_cycle(number):
    cycle = cycle_of(number)
    frames = replace(cycle.frames, position=np.full(len(cycle.frames), np.nan))
    return replace(cycle, frames=frames)


@pytest.fixture(scope="module")
def lived():
    """Return history and memories of cycles, three of them useless, one empty."""
    cycles = [bad_cycle(n) if n in {4, 30, 31} else cycle_of(n) for n in range(1, CYCLES)]
    cycles[19] = replace(cycles[19], frames=cycles[19].frames[:0])
    return run(cycles)


def force_of(memory):
    force = model_in_force(MODEL, memory, PERIOD_S, OPTIONS)
    assert force is not None
    return force


def flat(history):
    return [estimate for estimates in history for estimate in estimates]


@pytest.mark.parametrize("done", [0, 1, 12, 25, CYCLES - 1])
def test_memory_is_a_function_of_the_stored_estimates(lived, done):
    history, memories = lived
    running = repr(memories[done - 1]) if done else repr(Memory.empty())
    stored = flat(history[:done])
    assert repr(memory_from_history(stored)) == running
    assert repr(memory_from_history(stored[::-1])) == running


def test_memory_reaches_back_a_fixed_number_of_cycles(lived):
    cycles = {e.cycle for e in lived[1][-1].estimates}
    assert len(cycles) == MEMORY_CYCLES
    assert max(cycles) == CYCLES - 1


def test_a_restart_from_the_history_goes_on_with_the_same_bits(lived):
    history, memories = lived
    cycle = cycle_of(CYCLES)
    on = estimate_cycle(MODEL, OPTIONS, cycle, memories[-1])[0]
    again = estimate_cycle(MODEL, OPTIONS, cycle, memory_from_history(flat(history)))[0]
    assert repr(on) == repr(again)


def test_intervals_need_ten_cycles():
    history, _ = run(cycle_of(n) for n in range(1, MIN_CYCLES + 2))
    widths = [next(p for p in e.parameters if p.name == "K_in").upper_95 for e, *_ in history]
    assert np.isnan(widths[:MIN_CYCLES]).all()
    assert np.isfinite(widths[MIN_CYCLES])


def test_intervals_end_at_physical_bounds_and_never_stand_on_one(lived):
    bounds = {p.name: (p.lower, p.upper) for p in MODEL.parameters}
    for estimate in flat(lived[0]):
        for p in estimate.parameters:
            lower, upper = bounds[p.name]
            assert not p.lower_95 < lower
            assert not p.upper_95 > upper
            if p.status is ParameterStatus.AT_BOUND and estimate.estimator == "kalman":
                assert p.lower_95 <= p.value <= p.upper_95  # of this cycle alone: one-sided
            elif p.status is not ParameterStatus.OK:
                assert np.isnan([p.lower_95, p.upper_95, p.standard_error]).all()


def test_the_trend_uses_one_estimator(lived):
    assert {e.estimator for e in flat(lived[0]) if e.used_by_trend} == {"output_error"}


def test_test_errors_judge_the_model_before(lived):
    history, memories = lived
    force = force_of(memories[9])
    expected = evaluate(MODEL, force.coefficients, cycle_of(11).frames, PERIOD_S)
    estimate = history[10][0]
    assert (estimate.mse_test, estimate.fit_test) == expected
    assert estimate.fit_train > 95.0
    assert np.isnan([history[0][0].mse_test, history[0][0].fit_test]).all()


def test_a_useless_cycle_leaves_the_model_in_force(lived):
    history, memories = lived
    assert history[3][0].status is EstimateStatus.REFUSED
    before, after = (force_of(memories[i]) for i in (2, 3))
    assert before.coefficients.tobytes() == after.coefficients.tobytes()
    assert before.cycle == after.cycle == 3


def test_a_parameter_without_excitation_keeps_its_last_value(lived):
    memory = lived[1][2]
    newest = memory.of("output_error")[-1]
    silent = tuple(
        ParameterValue(p.name, np.nan, ParameterStatus.NOT_EXCITED, "no outflow")
        if p.name == "K_out"
        else p
        for p in newest.parameters
    )
    later = replace(newest, cycle=4, start_ns=newest.start_ns + 1, parameters=silent)
    force = force_of(memory.after([later]))
    last = force_of(memory)
    np.testing.assert_array_equal(force.coefficients, last.coefficients)
    assert force.cycle == 4


def test_no_model_before_the_first_estimate():
    assert model_in_force(MODEL, Memory.empty(), PERIOD_S, OPTIONS) is None


def test_expects_the_residual_it_has(lived):
    force = force_of(lived[1][-1])
    mse = evaluate(MODEL, force.coefficients, cycle_of(CYCLES + 1).frames, PERIOD_S)[0]
    assert force.residual_sigma == pytest.approx(mse**0.5, rel=0.15)


def test_takes_back_a_cycle_that_was_not_accepted():
    cycle = replace(cycle_of(1), accepted=False, reason="cut off by a clock jump")
    (estimate, *_), _ = estimate_cycle(MODEL, OPTIONS, cycle, Memory.empty())
    assert estimate.status is EstimateStatus.REFUSED
    assert estimate.reason == "cut off by a clock jump"
    assert np.isnan([p.value for p in estimate.parameters]).all()


def test_refuses_an_empty_cycle():
    frames = cycle_of(1).frames[:0]
    (estimate,), memory = estimate_cycle(
        MODEL, OPTIONS, Cycle(7, PERIOD_S, frames), Memory.empty()
    )
    assert estimate.status is EstimateStatus.REFUSED
    assert "no samples" in estimate.reason
    assert model_in_force(MODEL, memory, PERIOD_S, OPTIONS) is None


def test_scatter_ignores_a_slow_change_and_wild_cycles():
    rng = np.random.default_rng(3)
    values = 2.0 - 0.01 * np.arange(50) + 0.05 * rng.standard_normal(50)
    plain = scatter_between_cycles(values)
    values[[7, 33]] += 5.0
    assert plain.sigma == pytest.approx(0.05, rel=0.25)
    # the standard error of a standard deviation of 50 values is 10 %; an outlier left in makes 14x
    assert scatter_between_cycles(values).sigma == pytest.approx(plain.sigma, rel=0.2)


def test_scatter_intervals_cover_the_truth():
    """Normal scatter: coverage within three standard deviations of 95 %."""
    rng = np.random.default_rng(4)
    for n in (10, 20, 50):
        hits = 0
        for _ in range(600):
            values = rng.standard_normal(n + 1)
            hits += abs(values[-1]) <= scatter_between_cycles(values[:-1]).half_width_95
        assert hits / 600 == pytest.approx(0.95, abs=3 * (0.95 * 0.05 / 600) ** 0.5)


def test_scatter_of_a_constant_is_zero():
    assert scatter_between_cycles(np.full(12, 3.0)).sigma == 0.0


def test_a_model_that_is_worse_than_the_mean_on_the_next_cycle_is_told():
    truth = Truth()
    other = cycle_of(3, replace(truth, k_in=3.0 * truth.k_in))
    history, _ = run([cycle_of(1), cycle_of(2), other])
    trended = [next(e for e in cycle if e.used_by_trend) for cycle in history]
    told = [[g for g in e.guards if g.name == NEXT_CYCLE] for e in trended]
    assert told[:2] == [[], []]
    assert trended[2].status is EstimateStatus.ACCEPTED  # on its own cycle it is right
    assert [(g.passed, g.value) for g in told[2]] == [(False, trended[2].fit_test)]
    assert trended[2].fit_test < 0.0
