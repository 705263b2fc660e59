# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import pytest

from valve_twin.core.valves.press_cartridge.plc import PlcConfig, initial_state, plc_step

PLC = PlcConfig()


def steps(errors, *, hold=False, state=None):
    state = initial_state() if state is None else state
    return [plc_step(state, PLC.settings(), e, hold) for e in errors]


def test_first_command_is_the_gain_of_the_direction_times_the_error():
    # one task period of integral: 2 * 0.01 s and 0.5 * 0.01 s
    assert steps([0.05])[0] == pytest.approx(0.05 * (6.0 + 0.02))
    assert steps([-0.05])[0] == pytest.approx(-0.05 * (3.0 + 0.005))


def test_command_is_limited_in_both_directions_and_the_integral_waits():
    state = initial_state()
    assert steps([0.5] * 100, state=state) == [0.8] * 100
    assert state[0] == 0.0
    assert steps([-0.5] * 3) == [-0.8] * 3


def test_integral_raises_the_command_under_a_constant_error():
    commands = steps([0.02] * 100)
    assert commands[-1] - commands[0] == pytest.approx(2.0 * 0.02 * 0.99)


def test_output_goes_off_in_hold_inside_the_dead_band_and_stays_off_up_to_the_outer_band():
    inside, between, outside = 0.0019, 0.019, 0.021
    state = initial_state()
    assert steps([outside], hold=True, state=state)[0] > 0.0
    assert steps([between], hold=True, state=state)[0] > 0.0
    assert steps([inside, between, -between], hold=True, state=state) == [0.0, 0.0, 0.0]
    assert steps([outside], hold=True, state=state)[0] > 0.0


def test_output_does_not_go_off_while_the_reference_moves():
    assert steps([0.001])[0] > 0.0


def test_integral_is_dropped_when_the_error_changes_sign():
    state = initial_state()
    steps([0.05] * 50, state=state)
    assert steps([-0.01], state=state)[0] == pytest.approx(-0.01 * (3.0 + 0.005))


def test_refuses_bands_in_the_wrong_order():
    with pytest.raises(ValueError, match=r"band_on = 0.001: must not be below band_off = 0.002"):
        PlcConfig(band_on=0.001)


def test_refuses_a_limit_above_full_scale():
    with pytest.raises(ValueError, match=r"PlcConfig.limit = 1.2: must be a number from 0 to 1"):
        PlcConfig(limit=1.2)
