# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The compiled time step of the press valve's plant."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from valve_twin.core.valves.press_cartridge.orifice import root_slope, signed_root
from valve_twin.core.valves.press_cartridge.plc import PlcSettings, plc_step
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.simulation.plant import Forcing, Response
    from valve_twin.core.types import FloatArray

SHUT = 1e-30
"""Pilot opening that counts as shut: keeps the decay out of slow denormal numbers [1]."""


class PressCoefficients(NamedTuple):
    """Numbers of `PressCartridgePlant` as the kernel takes them, SI.

    `conductance_*` are the pilot areas times sqrt(2/rho), `top_force` is A_T Pz, `pilot_share` is
    the part of the way to its target that a pilot goes in one step, `resistance_in` that of the
    filling coil over new, `stick` the change of command that a sticking pilot does not follow
    (without command its spring closes it);
    the controller reads sensor_gain * position + sensor_offset.
    """

    conductance_in: float
    conductance_out: float
    saturation_in: float
    saturation_out: float
    offset_in: float
    offset_out: float
    pilot_share: float
    leak: float
    piston_area: float
    top_force: float
    mass: float
    damping: float
    stroke: float
    supply_pressure: float
    bulk_modulus: float
    dead_volume: float
    step_s: float
    resistance_in: float
    stick: float
    sensor_gain: float = 1.0
    sensor_offset: float = 0.0


@njit(cache=True)
def opening(command: float, offset: float, saturation: float) -> float:
    """Return the pilot opening that a command asks for [1].

    Parameters
    ----------
    command, offset : float
        Command, and the part of it that opens nothing [1].
    saturation : float
        What is missing at the whole command [1].
    """
    effective = min(max(command - offset, 0.0), 1.0)
    return effective * (1.0 - saturation * effective)


@njit(cache=True)
def _advance(
    state: FloatArray,
    c: PressCoefficients,
    target_in: float,
    target_out: float,
    leak: float,
    noise_flow: float,
    stuck: bool,
    steps: int,
) -> None:
    """Integrate `steps` steps under constant pilot targets.

    Pressure P and speed w at the end of the step solve, with the flow balance Q and its slope Q'
    at the start,
        (1 - h Q') P + h A w = P0 + h (Q - Q' P0),   (1 + dt B/M) w - (dt A/M) P = w0 - dt
        F_top/M,   h = dt beta/V.
    A spindle that would pass its seat stops there; the pressure then follows from the way it
    really went.
    """
    travel = state[0] * c.stroke
    speed, pressure, y_in, y_out = state[1], state[2], state[3], state[4]
    dt, area = c.step_s, c.piston_area
    inertia = 1.0 + dt * c.damping / c.mass
    for _ in range(steps):
        y_in += c.pilot_share * (target_in - y_in)
        y_out += c.pilot_share * (target_out - y_out)
        g_in = c.conductance_in * y_in
        g_out = c.conductance_out * y_out + leak
        drop = c.supply_pressure - pressure
        flow = g_in * signed_root(drop) - g_out * signed_root(pressure)
        slope = -g_in * root_slope(drop) - g_out * root_slope(pressure)
        if 0.0 < travel < c.stroke and (target_in > 0.0 or target_out > 0.0):
            flow += noise_flow
        h = dt * c.bulk_modulus / (c.dead_volume + area * travel)
        right = pressure + h * (flow - slope * pressure)
        free_speed = (speed - dt * c.top_force / c.mass) / inertia
        pull = dt * area / (c.mass * inertia)
        new_pressure = (right - h * area * free_speed) / (1.0 - h * slope + h * area * pull)
        new_speed = free_speed + pull * new_pressure
        new_travel = travel + dt * new_speed
        blocked = stuck or new_travel < 0.0 or new_travel > c.stroke
        if blocked:
            new_travel = travel if stuck else min(max(new_travel, 0.0), c.stroke)
            new_pressure = (right - h * area * (new_travel - travel) / dt) / (1.0 - h * slope)
            new_speed = 0.0
        travel, speed, pressure = new_travel, new_speed, new_pressure
    state[0] = travel / c.stroke
    state[1], state[2] = speed, pressure
    state[3] = y_in if y_in > SHUT else 0.0
    state[4] = y_out if y_out > SHUT else 0.0


@njit(cache=True)
def run_press(
    state: FloatArray,
    c: PressCoefficients,
    plc: PlcSettings,
    steps_per_tick: int,
    ticks_per_sample: int,
    forcing: Forcing,
    out: Response,
) -> None:
    """Run N samples of K controller ticks each.

    Parameters
    ----------
    state : (10,) array
        See `PressCartridgePlant.initial_state`; written in place.
    c, plc : PressCoefficients, PlcSettings
        Numbers of valve and controller.
    steps_per_tick, ticks_per_sample : int
        Steps of `c.step_s` in a tick; K.
    forcing : Forcing
        What acts on it; the disturbance is here the flow that process noise adds in motion
        [m^3/s], the leak is added to that of `c` [m^3/s/sqrt(Pa)].
    out : Response
        Overwritten: position at the stamps (N,), v_in and v_out (N, 2) [1].
    """
    reference, hold, external, commands, noise_flow, leak, stuck, frozen, freezes, lost = forcing
    position, inputs = out
    for n in range(len(position)):
        for k in range(ticks_per_sample):
            if not (frozen or freezes[n]):
                state[5] = c.sensor_gain * state[0] + c.sensor_offset
            if external:
                v_in = commands[n, 0]
                v_out = commands[n, 1]
            else:
                i = n * ticks_per_sample + k
                signed = plc_step(state[6:8], plc, reference[i] - state[5], hold[i])
                v_in = max(signed, 0.0)
                v_out = max(-signed, 0.0)
            if k == 0:
                position[n] = state[0]
                inputs[n, 0] = v_in
                inputs[n, 1] = v_out
            reach = 0.0 if lost[n] else 1.0
            if abs(reach * v_in - state[8]) > c.stick or v_in == 0.0:
                state[8] = reach * v_in
            if abs(reach * v_out - state[9]) > c.stick or v_out == 0.0:
                state[9] = reach * v_out
            _advance(
                state,
                c,
                opening(state[8] / c.resistance_in, c.offset_in, c.saturation_in),
                opening(state[9], c.offset_out, c.saturation_out),
                c.leak + leak,
                noise_flow[n],
                stuck,
                steps_per_tick,
            )
