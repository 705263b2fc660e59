# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Limits hold what a record cannot show: the time of the response, steps of the sensor."""

from dataclasses import replace

import numpy as np
import pytest

from test.core.valves.press_cartridge.generator import Truth, generate_cycle
from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.estimation.data.masks import find_masks
from valve_twin.core.simulation import simulate_cycles, to_frames
from valve_twin.core.types import Cycle, ParameterStatus, ParameterValue
from valve_twin.core.valves.press_cartridge import MODEL
from valve_twin.core.valves.press_cartridge.estimation.free_run import (
    OutputErrorOptions,
    acting_command,
    find_phases,
    lay_out,
)
from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import pole_likelihood
from valve_twin.core.valves.press_cartridge.estimation.response import unseen
from valve_twin.core.valves.press_cartridge.estimation.response.accuracy import (
    scatter_halves,
    with_limits,
)
from valve_twin.core.valves.press_cartridge.estimation.response.timing import find_timing
from valve_twin.core.valves.press_cartridge.estimation.response.unseen import (
    free_jumps,
    step_leak,
    timing_spread,
)
from valve_twin.core.valves.registry import complete_options

OPTIONS = OutputErrorOptions()
ALL = np.ones(5, np.bool_)
SIGMA = 1e-4


def run_of(sigma=SIGMA, seed=0):
    truth = Truth(sigma=sigma, process_noise=0.0)
    frames = generate_cycle(truth, np.random.default_rng([6, seed])).frames
    return lay_out(frames, find_masks(frames, 0.03, push=(1.0, -1.0)), 0.03, sigma, OPTIONS)


def spread_of_outflow(run):
    timing = find_timing(run, 2, ALL, OPTIONS)
    phases = find_phases(run, timing.delay, OPTIONS)
    return np.sqrt(timing_spread(run, phases, timing, ALL, OPTIONS)[2, 2])


def test_the_time_is_known_as_well_as_the_noise_lets_it():
    quiet, noisy = spread_of_outflow(run_of(1e-5)), spread_of_outflow(run_of(3e-3))
    assert noisy > 5.0 * quiet


@pytest.mark.parametrize("count", [1, 5, 8, 11])
@pytest.mark.parametrize("sigma", [1e-5, 1e-3])
def test_fits_of_several_delays_at_once_are_those_of_one_pass_each(sigma, count):
    run, pole, delays = run_of(sigma), 0.2, np.linspace(0.4, 3.1, count)
    freed = free_jumps(run, find_phases(run, 2.0, OPTIONS), OPTIONS)
    data, limits = freed.stretch(run.position, run.use), (OPTIONS.v_max, OPTIONS.wander)
    likelihood, linear = unseen._fit_each(data, run.v_in, run.v_out, delays, *limits, ALL, pole)
    for k, delay in enumerate(delays.tolist()):
        p, gram = np.zeros(5), np.zeros((7, 7))
        late = [acting_command(v, delay) for v in (run.v_in, run.v_out)]
        own = data._replace(v_in=late[0], v_out=late[1])
        alone = pole_likelihood(own, *limits, ALL, pole, p, gram)
        assert likelihood[k] == pytest.approx(alone, rel=1e-9)
        np.testing.assert_allclose(linear[k], p, rtol=1e-7, atol=1e-12)


def test_the_level_is_free_behind_a_command_that_jumps_off_the_seats():
    run = run_of()
    phases = find_phases(run, 2.0, OPTIONS)
    first = int(np.flatnonzero(phases.free & (np.diff(phases.v_out, prepend=0.0) > 0.3))[0])
    freed = free_jumps(run, phases, OPTIONS)
    assert freed.leaving[first]
    assert freed.anchor[first + 1] > phases.anchor[first + 1] + (1e-3 / SIGMA) ** 2
    still = replace(phases, v_in=0.0 * phases.v_in, v_out=0.0 * phases.v_out)
    assert np.array_equal(free_jumps(run, still, OPTIONS).anchor, phases.anchor)


@pytest.mark.parametrize(("noise", "share"), [(0.0, 1.0), (2.0, 0.0)])
def test_a_step_in_a_hold_is_what_a_leak_may_be_wrong_unless_noise_spreads_it(noise, share):
    run = run_of()
    step = 2.0**-8
    stepped = replace(run, position=step * np.round(run.position / step), noise_sigma=noise * step)
    phases = find_phases(run, 2.0, OPTIONS)
    holds = "".join("x" if h else " " for h in ~phases.moving & phases.free).split()
    longest = max(map(len, holds))
    assert step_leak(stepped, phases) == pytest.approx(share * step / longest, abs=1e-9)
    assert step_leak(run, phases) < 1e-3 * step / longest


def test_limits_of_the_leak_hold_it_where_the_sensor_has_few_bits():
    """Without the step 1 of 16 did."""
    given = MODEL.simulation()
    config = replace(
        given, measurement=replace(given.measurement, noise=1e-5, quantum=1.12 / 256), scatter=()
    )
    leak = MODEL.truth(config, config.first_cycle)["leak"]
    options = complete_options(MODEL, {"estimators": ("output_error", "kalman")})
    memory, held = Memory.empty(), []
    for number, block in enumerate(simulate_cycles(config, 18, seed=1), 1):
        cycle = Cycle(number, config.period_s, to_frames(block))
        estimates, memory = estimate_cycle(MODEL, options, cycle, memory)
        for e in estimates:
            p = next(p for p in e.parameters if p.name == "leak")
            if np.isfinite(p.upper_95) and number > 10:
                held.append(p.lower_95 <= leak <= p.upper_95)
    assert len(held) >= 8
    assert np.mean(held) >= 0.9


def test_a_value_on_its_bound_has_no_limits_from_the_scatter_of_others():
    bound = ParameterValue("leak", 0.0, ParameterStatus.AT_BOUND, "rests on its bound")
    (found,) = with_limits((bound,), {}, {"leak": 1e-5})
    assert np.isnan(found.lower_95)
    assert np.isnan(found.upper_95)


def test_limits_from_one_cycle_hold_the_scatter_of_those_before():
    gain = ParameterValue("K_in", 1.0)
    (wide,) = with_limits((gain,), {"K_in": 0.1}, {}, {"K_in": 0.5})
    assert (wide.standard_error, wide.upper_95) == (0.1, 1.5)
    (own,) = with_limits((gain,), {"K_in": 0.1}, {}, {"K_in": 0.1})
    assert own.upper_95 == pytest.approx(1.196, abs=1e-3)
    assert scatter_halves(()) == {}
