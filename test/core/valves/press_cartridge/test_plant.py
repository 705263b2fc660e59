# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The press plant against closed forms, an independent solver and the invariants of the valve."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from valve_twin.core.quantity import describe
from valve_twin.core.simulation import Drive, SimulatedValve
from valve_twin.core.simulation.config import SimulationConfig
from valve_twin.core.valves.press_cartridge.plant import PressCartridgePlant
from valve_twin.core.valves.press_cartridge.plc import PlcConfig
from valve_twin.core.valves.registry import get_simulation

PLANT = PressCartridgePlant()
T = 0.03
BALANCE = PLANT.area_ratio * PLANT.supply_pressure


HEALTHY = {"offset_in", "offset_out", "preload", "resistance_in", "stiction"}
"""Numbers that are those of a valve without faults: nothing is assumed."""


def drive(commands, **changes):
    """Return a drive under external commands (N, 2)."""
    commands = np.atleast_2d(np.asarray(commands, dtype=np.float64))
    ticks = len(commands) * 400
    nothing = {
        "reference": np.zeros(ticks),
        "hold": np.ones(ticks, dtype=np.bool_),
        "commands": commands,
        "disturbance": np.zeros(len(commands)),
    }
    return Drive(**(nothing | changes))


def at(position, plant=PLANT):
    """Return the state of a spindle at rest in mid-stroke, in balance."""
    state = plant.initial_state()
    state[0] = position
    state[2] = plant.area_ratio * plant.supply_pressure if 0.0 < position < 1.0 else 0.0
    return state


def constant(v_in, v_out, samples):
    return np.tile([v_in, v_out], (samples, 1))


@pytest.mark.parametrize(
    ("v", "gain"), [(0.05, 0.0097), (0.2, 0.0098), (0.5, 0.0093), (0.8, 0.0088)]
)
def test_steady_gain_opening_is_that_of_the_reference_experiment(v, gain):
    assert PLANT.steady_rate(np.array([v, 0.0])) * T / v == pytest.approx(gain, abs=5e-5)


@pytest.mark.parametrize(
    ("v", "gain"), [(0.1, 0.0494), (0.3, 0.0459), (0.6, 0.0410), (0.8, 0.0379)]
)
def test_steady_gain_closing_is_that_of_the_reference_experiment(v, gain):
    assert PLANT.steady_rate(np.array([0.0, v])) * T / v == pytest.approx(-gain, abs=5e-5)


@pytest.mark.parametrize(
    ("v_in", "v_out", "start", "samples"),
    [
        (0.05, 0, 0.3, 60),
        (0.2, 0, 0.3, 40),
        (0.8, 0, 0.1, 40),
        (0, 0.1, 0.9, 40),
        (0, 0.8, 0.9, 20),
    ],
)
def test_spindle_runs_at_the_steady_rate_under_a_constant_command(v_in, v_out, start, samples):
    position = PLANT.run(at(start), drive(constant(v_in, v_out, samples)), T).position
    rate = (position[-1] - position[-6]) / (5 * T)
    assert rate == pytest.approx(PLANT.steady_rate(np.array([v_in, v_out])), rel=2e-4)


def test_leak_alone_moves_the_spindle_by_its_share_of_the_stroke():
    # k sqrt(Pc0)/(A_B x_max), equations of the reference experiment: -9.5e-4 1/s
    assert PLANT.steady_rate(np.zeros(2)) == pytest.approx(-9.54e-4, abs=1e-6)


def test_positions_agree_with_an_independent_implicit_solver():
    p, y = PLANT, 0.5 * (1 - 0.05 * 0.5)

    def rhs(t, z):
        travel, speed, pressure = z
        opening = y * (1 - np.exp(-t / p.pilot_lag))
        flow = p.area_in * opening * np.sqrt(2 * (p.supply_pressure - pressure) / p.density)
        flow -= p.leak * np.sqrt(pressure)
        volume = p.dead_volume + p.piston_area * travel
        return [
            speed,
            (p.piston_area * (pressure - p.area_ratio * p.supply_pressure) - p.damping * speed)
            / p.mass,
            p.bulk_modulus / volume * (flow - p.piston_area * speed),
        ]

    times = np.arange(11) * T
    exact = solve_ivp(
        rhs, (0, 0.3), [0.4 * p.stroke, 0, BALANCE], "Radau", times, rtol=1e-10, atol=1e-10
    ).y[0]
    errors = []
    for step in (1e-4, 5e-5):
        plant = replace(p, step=step)
        position = plant.run(at(0.4), drive(constant(0.5, 0, 11)), T).position
        errors.append(np.abs(position - exact / p.stroke).max())
    assert errors[0] < 1e-4
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.2)  # first order in the step


def test_step_changes_a_production_cycle_by_no_more_than_the_published_figures():
    reference = np.where(np.arange(1500) < 600, 0.2, 0.0)
    hold = np.ones(1500, dtype=np.bool_)
    runs = {}
    for step in (2e-4, 1e-4, 5e-5):
        plant = replace(PLANT, step=step)
        job = Drive(reference, hold, None, np.zeros(500))
        runs[step] = plant.run(plant.initial_state(), job, T).position
    assert np.abs(runs[2e-4] - runs[1e-4]).max() < 1.3e-4
    assert np.abs(runs[5e-5] - runs[1e-4]).max() < 7e-5


def test_chamber_volume_balance_closes_through_motion_and_both_seats():
    plant = replace(PLANT, plc=PlcConfig(period_s=1e-4))
    state, p = at(0.98), plant
    states = [state.copy()]
    for v_in, v_out, steps in ((0.8, 0.0, 2500), (0.0, 0.8, 2500)):
        job = drive([[v_in, v_out]])
        for _ in range(steps):
            p.run(state, job, 1e-4)
            states.append(state.copy())
    travel, pressure, y_in, y_out = np.array(states)[:, [0, 2, 3, 4]].T
    travel = travel * p.stroke
    assert travel.max() == p.stroke
    flow = p.area_in * y_in[1:] * np.sqrt(2 * (p.supply_pressure - pressure[1:]) / p.density)
    flow -= p.area_out * y_out[1:] * np.sqrt(2 * pressure[1:] / p.density)
    flow -= p.leak * np.sqrt(pressure[1:])
    volume = p.dead_volume + p.piston_area * travel[:-1]
    stored = p.piston_area * np.diff(travel) + volume * np.diff(pressure) / p.bulk_modulus
    gap = np.abs(np.cumsum(flow * p.step) - np.cumsum(stored)).max()
    assert gap < 2e-3 * p.piston_area * p.stroke * np.ptp(travel / p.stroke)


commands = st.lists(
    st.tuples(st.floats(0, 1), st.floats(0, 1), st.integers(1, 60)), min_size=1, max_size=8
)


@settings(max_examples=60)
@given(commands, st.sampled_from([0.0, 0.3, 0.97, 1.0]))
def test_position_stays_in_the_stroke_and_pressure_between_tank_and_supply(program, start):
    state = at(start)
    for v_in, v_out, samples in program:
        position = PLANT.run(state, drive(constant(v_in, v_out, samples)), T).position
        assert position.min() >= 0.0
        assert position.max() <= 1.0
        assert -1.0 <= state[2] <= 1.02 * PLANT.supply_pressure  # compression transients only


def test_nothing_happens_at_rest_on_the_seat():
    state = PLANT.initial_state()
    noise = np.random.default_rng(3).standard_normal(200) * 2e-4
    position = PLANT.run(state, drive(constant(0, 0, 200), disturbance=noise), T).position
    assert not position.any()
    assert not state[:5].any()


def test_closing_command_on_the_seat_moves_nothing_and_opening_needs_the_balance_pressure():
    state = PLANT.initial_state()
    closing = PLANT.run(state, drive(constant(0, 0.8, 60)), T).position
    opening = PLANT.run(state, drive(constant(0.01, 0, 60)), T).position
    assert not closing.any()
    still = np.flatnonzero(opening > 0.0)[0] * T
    # the chamber takes up V0 Pc0/beta through an opening of 1 % before the spindle lifts
    filling = PLANT.dead_volume * BALANCE / PLANT.bulk_modulus
    fastest = 0.01 * PLANT.area_in * np.sqrt(2 * PLANT.supply_pressure / PLANT.density)
    assert still > filling / fastest


def test_pilot_offset_shuts_small_commands():
    plant = replace(PLANT, offset_in=0.02, leak=0.0)
    still = plant.run(at(0.5), drive(constant(0.02, 0, 30)), T).position
    assert np.ptp(still) == 0.0
    shifted, plain = np.array([0.32, 0.0]), np.array([0.30, 0.0])
    assert plant.steady_rate(shifted) == pytest.approx(
        replace(PLANT, leak=0.0).steady_rate(plain), rel=1e-12
    )


def test_disturbance_moves_the_spindle_by_its_size_in_motion_only():
    noise = np.full(20, 5e-4)
    moving = drive(constant(0.2, 0, 20))
    quiet = PLANT.run(at(0.4), moving, T).position
    loud = PLANT.run(at(0.4), replace(moving, disturbance=noise), T).position
    shift = np.diff(loud - quiet)[10:]
    # the flow pushes against the viscous force and the supply, so a few per cent are lost
    assert shift == pytest.approx(5e-4, rel=0.05)
    still = replace(drive(constant(0, 0, 20)), disturbance=noise)
    at_rest = PLANT.run(at(0.4), still, T).position
    assert at_rest[-1] < 0.4


def test_stuck_spindle_stays_where_it_is():
    state = at(0.4)
    assert set(PLANT.run(state, drive(constant(0.8, 0, 50), stuck=True), T).position) == {0.4}
    assert PLANT.run(state, drive(constant(0.8, 0, 50)), T).position[-1] > 0.6


def test_leak_fault_adds_its_rate():
    slope = np.diff(PLANT.run(at(0.5), drive(constant(0, 0, 80), leak_rate=5e-3), T).position)
    rate = slope[-20:].mean() / T
    assert rate == pytest.approx(PLANT.steady_rate(np.zeros(2)) - 5e-3, rel=1e-3)


def test_controller_goes_on_with_the_last_position_while_the_sensor_is_frozen():
    state = at(0.4)
    state[5] = 0.4
    job = Drive(np.full(150, 0.5), np.zeros(150, dtype=np.bool_), None, np.zeros(50), frozen=True)
    response = PLANT.run(state, job, T)
    assert response.position[-1] > 0.52
    assert response.inputs[-1, 0] > response.inputs[0, 0]


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        (
            {"mass": -80.0},
            r"PressCartridgePlant.mass = -80.0: must be a number from 0.01 to 10000",
        ),
        ({"area_ratio": 1.0}, r"area_ratio = 1.0: must be a number from 0.05 to 0.99 \[1\]"),
        ({"bulk_modulus": float("nan")}, r"bulk_modulus = nan"),
        ({"step": 3e-4}, r"plc.period_s = 0.01: must be a whole multiple of step = 0.0003"),
    ],
)
def test_refuses_numbers_that_are_not_physical(changes, text):
    with pytest.raises(ValueError, match=text):
        PressCartridgePlant(**changes)


def test_refuses_a_sampling_time_that_does_not_fit_the_controller():
    with pytest.raises(ValueError, match=r"period_s = 0.025: must be a whole multiple of plc.per"):
        PLANT.ticks_per_sample(0.025)


def test_every_number_states_unit_range_and_whether_it_is_an_assumption():
    known = [d for d in describe(PLANT) if not d.name.startswith("plc.")]
    assert {f.name for f in fields(PLANT)} == {d.name for d in known} | {"plc"}
    for item in known:
        assert item.unit
        assert item.text
        assert np.isfinite([item.lower, item.upper]).all()
        assert item.assumed is (item.name not in HEALTHY)


@pytest.mark.parametrize("kind", PLANT.fault_kinds)
def test_every_fault_changes_what_the_valve_does_and_none_changes_nothing(kind):
    def stroke(severity):
        valve = SimulatedValve(SimulationConfig(PLANT))
        valve.set_fault(kind, severity)
        block = valve.advance(400)
        return np.stack((block.position, *block.inputs.T))

    assert not np.array_equal(stroke(0.05), stroke(0.0))
    np.testing.assert_array_equal(stroke(0.0), np.stack(_healthy_stroke()))


def _healthy_stroke():
    block = SimulatedValve(SimulationConfig(PLANT)).advance(400)
    return block.position, *block.inputs.T


def test_a_lost_command_is_logged_and_moves_nothing():
    valve = SimulatedValve(SimulationConfig(PLANT))
    valve.set_fault("command_loss", 1.0)
    block = valve.advance(200)
    assert block.inputs.max() == 0.8
    assert block.true_position.max() == 0.0


def test_a_valve_refuses_faults_that_its_plant_does_not_take():
    stepper = SimulatedValve(get_simulation("stepper_servo"))
    with pytest.raises(ValueError, match=r"fault.kind = 'aeration': this valve takes leak, stuck"):
        stepper.set_fault("aeration", 0.1)
