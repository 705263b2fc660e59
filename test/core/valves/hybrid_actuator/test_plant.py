# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from valve_twin.core.simulation import SimulatedValve, configure
from valve_twin.core.simulation.plant import Drive
from valve_twin.core.valves.hybrid_actuator.magnetics import (
    FIT,
    KERNELS,
    LINEAR,
    REGULAR,
    coil_current,
    coil_force,
)
from valve_twin.core.valves.hybrid_actuator.plant import HybridActuatorPlant, default_simulation
from valve_twin.core.valves.hybrid_actuator.plant_kernel import (
    FLUX_CLOSER,
    FLUX_OPENER,
    OPEN_CLOSER,
    OPEN_OPENER,
    SPEED,
    STATE_SIZE,
    X,
    follow,
    step,
)

PAPER = HybridActuatorPlant(
    kernel="linear",
    magnet_force=0.0,
    resistance_opener=0.35,
    resistance_closer=0.35,
    residual_gap=1e-3,
)
"""The model of the thesis: no magnet, R 0.35 ohm, and the gap that fits its travels."""


def pulse(kernel, volts, gap=0.5e-3, resistance=0.35, pulse_s=1.5e-3):
    """Return current, force and flux at the end of a pulse on a held armature."""
    plant = replace(PAPER, kernel=KERNELS[kernel], residual_gap=gap, resistance_opener=resistance)
    a, m = plant.armature(), plant.magnetics()
    state = np.zeros(STATE_SIZE)
    state[X] = a.travel
    volt = np.tile([volts, 0.0], (round(pulse_s / 1e-5), 1))
    follow(state, a, m, m, volt, 1e-5, True, np.empty((len(volt), 4)))
    current = coil_current(m, state[FLUX_OPENER], gap)
    return current, coil_force(m, current, gap), state[FLUX_OPENER]


@pytest.mark.parametrize(
    ("kernel", "volts", "current", "newton", "published", "band"),
    [
        (LINEAR, 24.0, 25.702, 736.8, 736.0, 0.01),
        (LINEAR, 12.0, 12.851, 184.2, None, None),
        (FIT, 24.0, 30.550, 838.9, 839.0, 0.012),
        (FIT, 12.0, 12.234, 193.5, 193.0, 0.012),
        (REGULAR, 24.0, 35.181, 718.8, None, None),
        (REGULAR, 12.0, 14.499, 169.6, None, None),
    ],
)
def test_reproduces_current_and_force_of_a_pulse(kernel, volts, current, newton, published, band):
    """equations.md 1.3 and 6: 001-F1, F2, F3, I."""
    i, f, _ = pulse(kernel, volts)
    assert i == pytest.approx(current, rel=1e-3)
    assert f == pytest.approx(newton, rel=1e-3)
    if published is not None:
        assert f == pytest.approx(published, rel=band)


@pytest.mark.parametrize("kernel", [LINEAR, FIT])
def test_the_peak_current_is_within_15_percent_of_the_finite_element_value(kernel):
    assert pulse(kernel, 24.0)[0] == pytest.approx(29.0, rel=0.15)


@pytest.mark.parametrize(("resistance", "newton"), [(0.34, 746.0), (0.37, 719.0)])
def test_the_measured_resistances_shift_the_force(resistance, newton):
    assert pulse(LINEAR, 24.0, resistance=resistance)[1] == pytest.approx(newton, rel=2e-3)


def test_twice_the_voltage_gives_exactly_four_times_the_linear_force():
    assert pulse(LINEAR, 24.0)[1] / pulse(LINEAR, 12.0)[1] == pytest.approx(4.0, rel=1e-12)


@pytest.mark.parametrize("kernel", [LINEAR, REGULAR, FIT])
def test_flux_decays_at_r_over_l_after_the_pulse(kernel):
    plant = replace(PAPER, kernel=KERNELS[kernel])
    a, m = plant.armature()._replace(blocks=False), plant.magnetics()
    state, work = np.zeros(STATE_SIZE), np.zeros(8)
    state[X], state[FLUX_OPENER] = a.travel, 1e-6
    inductance = 1e-6 / coil_current(m, 1e-6, a.residual_gap)
    for _ in range(100):
        step(state, a, m, m, (0.0, 0.0), 1e-5, True, work)
    left = math.exp(-1e-3 * a.resistance_opener / inductance)
    assert state[FLUX_OPENER] == pytest.approx(1e-6 * left, rel=1e-4)


def throw(plant, h=1e-5, duration_s=0.015, pulse_s=1.5e-3):
    """Return positions, speeds and the worst energy error of a thrown armature."""
    m = plant.magnetics()
    volts = np.zeros((round(duration_s / h), 2))
    volts[: round(pulse_s / h), 0] = plant.supply_voltage
    out = np.empty((len(volts), 4))
    follow(plant.initial_state(), plant.armature(), m, m, volts, h, False, out)
    return out[:, 0], out[:, 1], np.abs(out[:, 3]).max() / np.abs(out[:, 2]).max()


@pytest.mark.parametrize(
    ("kernel", "gap", "travel", "speed"),
    [
        (LINEAR, 1e-3, 3.737e-3, 1.508),
        (FIT, 1e-3, 3.755e-3, 1.515),
        (LINEAR, 0.5e-3, 3.761e-3, 1.517),
        (FIT, 0.5e-3, 3.781e-3, 1.525),
    ],
)
def test_reproduces_travel_and_speed_of_the_thrown_armature(kernel, gap, travel, speed):
    """equations.md 1.3 and 6: 001-X within 1 %, 001-V within 3 % of the published 1.5 m/s."""
    x, v, _ = throw(replace(PAPER, kernel=KERNELS[kernel], residual_gap=gap))
    assert x.max() == pytest.approx(travel, rel=5e-4)
    assert v.max() == pytest.approx(speed, rel=1e-3)
    published = 3.73e-3 if kernel == LINEAR else 3.75e-3
    assert x.max() == pytest.approx(published, rel=0.01)
    assert v.max() == pytest.approx(1.5, rel=0.03)
    if (kernel, gap) == (LINEAR, 1e-3):
        assert v.min() == pytest.approx(-1.346, rel=1e-3)
        assert np.argmax(x) * 1e-5 == pytest.approx(7.99e-3, abs=5e-5)


def test_flies_freely_without_a_pulse():
    x, v, _ = throw(PAPER, pulse_s=0.0)
    assert x.max() == pytest.approx(3.572e-3, rel=5e-4)
    assert v.max() == pytest.approx(1.441, rel=1e-3)


def test_mass_follows_from_the_printed_damping_formula():
    """equations.md 1.2, item 4: c = xi sqrt(m k) as printed."""
    assert PAPER.mass == pytest.approx((3.559 / 0.072) ** 2 / 18820.0, rel=1e-4)


def test_the_integration_is_of_order_four():
    exact = throw(PAPER, 2.5e-6, 5e-3)[0][-1]
    errors = [abs(throw(PAPER, h, 5e-3)[0][-1] - exact) for h in (1e-4, 5e-5)]
    assert 3.0 < np.log2(errors[0] / errors[1]) < 5.5


@settings(deadline=None, max_examples=30)
@given(
    kernel=st.sampled_from(KERNELS[:2]),
    magnet=st.floats(0.0, 200.0),
    coupling=st.floats(0.0, 0.9),
    restitution=st.floats(0.0, 0.9),
    gas=st.floats(-100.0, 50.0),
    supply=st.floats(5.0, 30.0),
)
def test_energy_balance_closes(kernel, magnet, coupling, restitution, gas, supply):
    """Stored + lost - put in, with impacts, gas and the coil's blocking, below 1e-6."""
    plant = replace(
        PAPER,
        kernel=kernel,
        magnet_force=magnet,
        magnet_coupling=coupling,
        restitution=restitution,
        gas_force=gas,
        supply_voltage=supply,
    )
    x, _, error = throw(plant, h=5e-6, pulse_s=6e-3)
    assert error < 1e-6
    assert np.abs(x).max() <= plant.half_travel


def test_restitution_is_kept_at_an_impact():
    plant = replace(PAPER, restitution=0.5, spring_rate=10.0, damping=0.0)
    a, m = plant.armature(), plant.magnetics()
    state, work = np.zeros(STATE_SIZE), np.zeros(8)
    state[SPEED] = 1.0
    while state[SPEED] > 0.0:
        before = state[SPEED]
        step(state, a, m, m, (0.0, 0.0), 1e-5, False, work)
    assert -state[SPEED] / before == pytest.approx(0.5, rel=1e-3)


def test_a_bridge_that_is_off_blocks_once_the_current_has_died():
    valve = SimulatedValve(default_simulation(), seed=0)
    block = valve.advance(990)
    closer = block.inputs[:, 3]
    assert closer.min() < -0.1
    dead = np.flatnonzero(closer < 0.0)[-1] + 1
    assert (closer[dead:] == 0.0).all()
    assert valve._state[OPEN_OPENER] == 1.0


def test_opens_and_closes_and_stays_latched():
    block = SimulatedValve(default_simulation(), seed=0).advance(2000)
    assert (block.true_position[300:1000] == 1.0).all()
    assert (block.true_position[1300:] == 0.0).all()
    assert block.true_position[:20].max() == 0.0


def test_any_split_of_the_samples_gives_the_same_bits():
    whole = SimulatedValve(default_simulation(), seed=4).advance(1500)
    valve = SimulatedValve(default_simulation(), seed=4)
    parts = [valve.advance(n) for n in (1, 22, 477, 0, 1000)]
    for name in ("position", "inputs", "true_position", "reference"):
        joined = np.concatenate([getattr(p, name) for p in parts])
        np.testing.assert_array_equal(joined, getattr(whole, name))


def test_a_stuck_armature_stays():
    valve = SimulatedValve(default_simulation(), seed=0)
    valve.set_fault("stuck")
    assert valve.advance(1000).true_position.max() == 0.0


def test_external_voltages_drive_the_coils():
    config = configure(default_simulation(), {"controller": "external"})
    commands = np.zeros((300, 4))
    commands[:100, 1] = 0.5
    block = SimulatedValve(config, 0).advance(300, commands)
    assert block.inputs[99, 3] * 50.0 == pytest.approx(12.0 / 0.37, rel=0.02)
    np.testing.assert_array_equal(block.inputs[:, 1], commands[:, 1])
    assert block.true_position.max() == 0.0


def test_gas_force_delays_the_opening():
    quiet = SimulatedValve(default_simulation(), 0).advance(200).true_position
    config = configure(default_simulation(), {"plant.gas_force": 20.0})
    loaded = SimulatedValve(config, 0).advance(200).true_position
    assert np.argmax(loaded > 0.5) > np.argmax(quiet > 0.5)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mass": -0.1}, r"mass = -0.1: must be a number from 0.001 to 10 \[kg\]"),
        ({"spring_rate": math.nan}, "spring_rate = nan: must be a number from 10"),
        ({"resistance_opener": 0.0}, "resistance_opener = 0.0: must be a number from 0.001"),
        (
            {"kernel": "saturating_fit", "residual_gap": 5e-5},
            r"residual_gap = 5e-05: must be a number from 0.0001\d* to 0.005 \[m\]",
        ),
        ({"kernel": "cubic"}, "kernel = 'cubic': must be one of linear, saturating"),
        ({"restitution": 1.5}, "restitution = 1.5: must be a number from 0 to 0.99"),
    ],
)
def test_refuses_what_is_not_physical(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(HybridActuatorPlant(), **changes)


def test_refuses_a_period_that_is_no_multiple_of_the_step():
    with pytest.raises(ValueError, match="must be a whole multiple of step"):
        HybridActuatorPlant().ticks_per_sample(1.25e-5)


def test_refuses_a_sampling_that_shows_no_flight():
    with pytest.raises(ValueError, match=r"period_s = 0.001: must be at most 0.00025 \[s\]"):
        HybridActuatorPlant().ticks_per_sample(1e-3)


def test_an_integration_that_fails_is_a_value_with_time_and_state():
    plant = HybridActuatorPlant()
    drive = Drive(np.zeros(50), np.ones(50, dtype=np.bool_), None, np.zeros(50))
    state = plant.initial_state()
    assert plant.failure(state) == ""
    state[FLUX_CLOSER] = math.nan
    state[OPEN_CLOSER] = 0.0
    position = plant.run(state, drive, 1e-4).position
    assert position[0] == 0.0
    assert np.isnan(position[1:]).all()
    assert "integration failed at 0.000010 s: x =" in plant.failure(state)
