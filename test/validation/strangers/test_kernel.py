# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The stranger's press obeys its own equations, and the simulator's where the two agree."""

import numpy as np
import pytest

from valve_twin.core.simulation.settings import configure
from valve_twin.core.simulation.valve import SimulatedValve
from valve_twin.core.valves.registry import get_simulation
from valve_twin.validation.strangers.draw import draw
from valve_twin.validation.strangers.kernel import STEP_S, TRACE_S, run_cycle, steady_speed

OPEN_LOOP = 1e4  # gain at which a reference far away saturates the command


def reference_press():
    """The press of equations.md 2.3, without what it does not have."""
    return draw(0).press._replace(
        mass=80.0,
        damping=2500.0,
        area_bottom=2e-3,
        area_top=1.92e-3,
        stroke=0.9,
        supply=3e7,
        bulk=2.1e9,
        volume=1e-3,
        gas=0.0,
        r_in=1.27e-5,
        r_out=1.27e-5,
        saturation_in=0.05,
        saturation_out=0.30,
        lag_in=8e-3,
        lag_out=8e-3,
        rate=1e3,
        offset_in=0.0,
        offset_out=0.0,
        leak=3.2e-10,
        coulomb=0.0,
        breakaway=0.0,
        load=0.0,
        play=0.0,
    )


@pytest.mark.parametrize(("v_in", "v_out"), [(0.05, 0.0), (0.5, 0.0), (0.8, 0.0), (0.0, 0.3)])
def test_its_steady_speed_is_that_of_the_other_program(v_in, v_out):
    plant = SimulatedValve(configure(get_simulation("press_cartridge"), {})).aged_plant(1)
    other = plant.steady_rate(np.array([v_in, v_out]))
    # the stranger's orifices turn laminar below 2 bar: 1 % less flow at the 12 bar of the inflow
    assert steady_speed(reference_press(), v_in, v_out) == pytest.approx(other, rel=0.012)


@pytest.mark.parametrize("seed", range(6))
def test_the_integration_settles_at_the_steady_speed(seed):
    stranger = draw(seed)
    plc = stranger.plc._replace(gain_in=OPEN_LOOP, limit=0.4, filter_share=1.0)
    press = stranger.press._replace(play=0.0)
    ticks = round(1.0 / (plc.ticks * STEP_S))
    state = np.array([0.1 * press.stroke, 0.0, press.supply * 0.95, 0.0, 0.0])
    trace, commands = run_cycle(
        state,
        np.zeros(6),
        press,
        plc,
        np.full(ticks, 1.0),
        np.zeros(ticks),
        np.zeros(ticks),
        False,
    )
    assert np.all(commands[:, 0] == 0.4)
    late = trace[len(trace) // 2 :]
    speed = (late[-1] - late[0]) / (TRACE_S * (len(late) - 1))
    assert speed == pytest.approx(steady_speed(press, 0.4, 0.0), rel=2e-3)


def test_a_stuck_spindle_stays_and_a_lost_command_moves_nothing():
    stranger = draw(0)
    far, none = np.full(100, 0.5), np.zeros(100)
    for lost, stuck in ((none, True), (none + 1.0, False)):
        state = np.array([0.2 * stranger.press.stroke, 0.0, stranger.press.supply, 0.0, 0.0])
        trace, commands = run_cycle(
            state, np.zeros(6), stranger.press, stranger.plc, far, none, lost, stuck
        )
        assert commands[:, 0].max() > 0.5
        assert trace[-1] <= trace[0] + 1e-3
