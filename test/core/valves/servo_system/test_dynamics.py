# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The thirteen equations: an independent statement, their Jacobian, invariants, scipy's Radau."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from valve_twin.bench.models.servo_peer import loop
from valve_twin.core.physics.hysteresis import PLAYS
from valve_twin.core.valves.servo_system import dynamics as d
from valve_twin.core.valves.servo_system.integrate import FIRST_STEP, advance, rest, simulate, span
from valve_twin.core.valves.servo_system.plant import ServoSystemPlant

PLANT = ServoSystemPlant(hysteresis_width=0.0)
"""Without hysteresis: that is what solvers of ordinary differential equations can check."""

SEEDS = st.integers(0, 2**31)


def controls(wanted, *, fed_back=np.nan, held=0.0, leak=0.0):
    return np.array([wanted, fed_back, held, leak])


def somewhere(seed, share=0.3):
    """A state with positive pressures, not resting."""
    rng = np.random.default_rng(seed)
    y = d.FLOOR * share * rng.standard_normal(d.STATES)
    y[[d.PLS, d.P1, d.P2, d.PLR]] = rng.uniform([10e6, 1e6, 1e6, 0.3e6], [20e6, 9e6, 9e6, 0.9e6])
    return y


def evaluate(y, plant=PLANT, u=None, memory=None, p=None):
    p = plant.numbers() if p is None else p
    u = controls(0.01) if u is None else u
    memory = np.zeros(PLAYS) if memory is None else memory
    work, dy, jac = np.empty(d.WORK), np.empty(d.STATES), np.empty((d.STATES, d.STATES))
    d.evaluate(y, p, memory, u, work, dy, jac, True)
    return dy, jac, work


def at_rest(plant=PLANT, place=0.0):
    y, memory, p = np.zeros(d.STATES), np.zeros(PLAYS), plant.numbers()
    assert rest(place, p, y, memory)
    return y, memory, p


@given(SEEDS)
@settings(max_examples=50)
def test_agrees_with_the_equations_written_down_on_their_own(seed):
    y = somewhere(seed)
    dy, _, _ = evaluate(y)
    scale = d.FLOOR + np.abs(dy)
    np.testing.assert_allclose(dy / scale, loop(PLANT, 0.01)(0.0, y) / scale, rtol=0, atol=1e-11)


@given(SEEDS)
@settings(max_examples=50)
def test_jacobian_is_the_derivative(seed):
    plant = ServoSystemPlant()
    y, p = somewhere(seed), plant.numbers()
    memory = y[d.IS] + 0.4e-3 * np.random.default_rng(seed).uniform(-1, 1, PLAYS)
    u = controls(0.01, leak=1e-10)
    _, jac, _ = evaluate(y, plant, u, memory)
    measured = np.empty_like(jac)
    for j in range(d.STATES):
        step = 1e-6 * d.FLOOR[j]
        up, down = y.copy(), y.copy()
        up[j] += step
        down[j] -= step
        high, low = evaluate(up, p=p, u=u, memory=memory), evaluate(down, p=p, u=u, memory=memory)
        measured[:, j] = (high[0] - low[0]) / (2.0 * step)
    scale = d.FLOOR[None, :] / (d.FLOOR[:, None] + np.abs(evaluate(y, plant, u)[0])[:, None])
    np.testing.assert_allclose(jac * scale, measured * scale, rtol=2e-3, atol=2e-2)


@given(st.floats(-3e-4, 3e-4), st.floats(0.0, 2e7))
def test_nothing_flows_without_a_pressure_drop(x, pressure):
    y = np.zeros(d.STATES)
    y[[d.PLS, d.P1, d.P2, d.PLR]] = pressure
    y[d.XV] = x
    work = np.empty(d.WORK)
    d.flows(y, PLANT.numbers(), work)
    np.testing.assert_array_equal(work[:5], 0.0)


@given(SEEDS)
def test_chambers_keep_their_volume_balance(seed):
    """Compliance times pressure rate is inflow minus displaced volume, in either chamber."""
    y = somewhere(seed)
    dy, _, work = evaluate(y)
    p = PLANT
    wall = p.line_bore / (p.line_modulus * p.line_wall)
    line = np.pi * p.line_bore**2 / 4 * p.length_1
    for pressure, area, side, inflow in (
        (d.P1, p.area_1, 1.0, work[0] - work[2]),
        (d.P2, p.area_2, -1.0, work[1] - work[3]),
    ):
        total = y[pressure] + 1.013e5
        air = p.air_share * (1.013e5 / total) ** (1 / 1.4) / (1.4 * total)
        room = area * (p.stroke / 2 + p.dead_length + side * y[d.XP]) + line
        compliance = line * wall + room * (1.0 / p.bulk_modulus + air)
        stored = compliance * dy[pressure] + side * area * y[d.VP]
        assert stored == pytest.approx(inflow, rel=1e-9, abs=1e-15)


def test_motion_and_pressures_decay_without_a_supply():
    """With P_s = P_r and no current everything comes to rest at the return pressure."""
    plant = replace(PLANT, supply_pressure=0.35e6, position_gain=0.0, velocity_gain=0.0,
                    force_gain=0.0)  # fmt: skip
    y, memory, p = np.zeros(d.STATES), np.zeros(PLAYS), plant.numbers()
    y[[d.PLS, d.P1, d.P2, d.PLR]] = 2e6, 5e6, 1e6, 1e6
    y[d.VP], y[d.OM] = 0.1, 1.0
    out = np.empty((200, d.STATES))
    _, reached, _ = span(y, memory, p, controls(0.0), 0.01, FIRST_STEP, 1e-6, out)
    assert reached == pytest.approx(2.0)
    assert np.abs(out[-1, d.VP]) < 1e-3
    assert np.abs(out[-1, d.OM]) < 2e-2
    assert abs(out[-1, d.PLS] - 0.35e6) < 0.05e6
    kinetic = out[:, d.OM] ** 2
    assert kinetic[150:].max() < 1e-2 * kinetic[:5].max()


@pytest.mark.no_cover
def test_agrees_with_radau_to_1e_9():
    """10 mm wanted, 30 ms: current limit, valve stop, acceleration, line oscillation."""
    y, memory, p = at_rest()
    theirs = solve_ivp(
        loop(PLANT, 0.01), (0.0, 0.03), y, method="Radau", rtol=1e-11, atol=1e-12 * d.FLOOR
    ).y[:, -1]
    _, reached, _ = advance(y, memory, p, controls(0.01), 0.03, FIRST_STEP, 1e-10)
    assert reached == 0.03
    np.testing.assert_allclose(y / (d.FLOOR + np.abs(theirs)),
                               theirs / (d.FLOOR + np.abs(theirs)), rtol=0, atol=1e-9)  # fmt: skip


def test_error_falls_with_the_tolerance_also_with_hysteresis():
    results = []
    for rtol in (1e-3, 1e-5, 1e-7, 1e-9):
        y, memory, p = at_rest(ServoSystemPlant())
        advance(y, memory, p, controls(0.005), 0.02, FIRST_STEP, rtol)
        results.append(y / d.FLOOR)
    errors = [np.abs(r - results[-1]).max() for r in results[:-1]]
    assert errors[0] > 5 * errors[1] > 25 * errors[2]
    assert errors[2] < 1e-5


def test_a_record_is_the_same_as_its_samples_one_by_one():
    plant = ServoSystemPlant()
    y, memory, p = at_rest(plant)
    wanted = np.repeat([0.0, 0.01, -0.005, 0.0], 50)
    whole, single = np.empty((200, d.STATES)), np.empty((200, d.STATES))
    z, kept = y.copy(), memory.copy()
    assert simulate(z, kept, p, wanted, 1e-3, 1e-7, whole) == 200
    h = FIRST_STEP
    for n in range(200):
        single[n] = y
        h, _, _ = advance(y, memory, p, controls(wanted[n]), 1e-3, h, 1e-7)
    np.testing.assert_allclose(whole / d.FLOOR, single / d.FLOOR, rtol=0, atol=2e-3)


def test_failure_is_told_with_its_time_and_does_not_hang():
    y, memory, p = at_rest()
    y[d.P1] = np.nan
    _, reached, count = advance(y, memory, p, controls(0.01), 1.0, FIRST_STEP, 1e-4)
    assert reached == 0.0
    assert count < 100


@pytest.mark.parametrize(("wanted", "rise_ms", "speed", "valve_um", "force"),
                         [(0.010, 139.0, 0.14, 220.0, 533.0)])  # fmt: skip
def test_step_responses_are_those_of_the_chosen_parameters(
    wanted, rise_ms, speed, valve_um, force
):
    """A regression of our own numbers: the paper prints none."""
    y, memory, p = at_rest()
    out = np.empty((600, d.STATES))
    span(y, memory, p, controls(wanted), 1e-3, FIRST_STEP, 1e-6, out)
    x = out[:, d.XP]
    rise = np.argmax(x > 0.9 * wanted) - np.argmax(x > 0.1 * wanted)
    stretch = x - PLANT.arm * np.sin(out[:, d.TH])
    rate = out[:, d.VP] - PLANT.arm * out[:, d.OM] * np.cos(out[:, d.TH])
    pull = PLANT.structural_stiffness * stretch + PLANT.structural_damping * rate
    assert rise == pytest.approx(rise_ms, rel=0.2)
    assert out[:, d.VP].max() == pytest.approx(speed, rel=0.05)
    assert 1e6 * out[:, d.XV].max() == pytest.approx(valve_um, rel=0.02)
    assert np.abs(pull).max() == pytest.approx(force, rel=0.05)
    assert out[:, d.PLS].min() < 20.0e6
    assert out[:, d.PLR].max() == pytest.approx(0.906e6, rel=0.01)  # 0.86 with stiff line fluid


def test_structural_damper_takes_energy_away():
    """The printed sign of b_s (v_p - v_L) would drive a limit cycle."""
    y, memory, p = at_rest()
    y[d.VP] = 0.05
    out = np.empty((300, d.STATES))
    span(y, memory, p, controls(y[d.XP]), 1e-3, FIRST_STEP, 1e-6, out)
    relative = out[:, d.VP] - PLANT.arm * out[:, d.OM]
    assert np.abs(relative[200:]).max() < 1e-3
