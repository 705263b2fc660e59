# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A press cartridge valve from first principles, with its PLC: one production cycle, compiled.

Spindle, chamber and pilots are written here anew and integrated by classic Runge-Kutta steps; no
kernel of the simulator or of the twin is used, so that a fault in one of them shows.

    M u' = A_B P - A_T P_z - B u - F(u) - F_load + seats        x' = u
    (V(x)/beta + V_gas p_0/P^2) P' = Q_in(P) - Q_out(P) - k_leak sqrt(P) - A_B u
    y' = (saturated opening of the command - y)/tau,            limited in rate
    F(u) = (F_c + (F_s - F_c) exp(-(u/v_s)^2)) tanh(u/v_r)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

STEP_S = 2.5e-4
"""Step of the integration [s]."""

TRACE_S = 1e-3
"""Interval of the recorded position [s]."""

_PER_TRACE = 4
_P0 = 1.013e5
_LEAST_P = 1e3


class Press(NamedTuple):
    """Numbers of one press, SI; `pilots` are (inflow, outflow) pairs written one by one."""

    mass: float
    damping: float
    area_bottom: float
    area_top: float
    stroke: float
    density: float
    supply: float
    bulk: float
    volume: float
    gas: float
    r_in: float
    r_out: float
    saturation_in: float
    saturation_out: float
    lag_in: float
    lag_out: float
    rate: float
    offset_in: float
    offset_out: float
    leak: float
    coulomb: float
    breakaway: float
    stribeck: float
    smooth: float
    seat: float
    seat_damping: float
    load: float
    play: float
    preload: float
    coil: float
    command_offset: float


class Plc(NamedTuple):
    """Numbers of the controller: gains [1], [1/s], limit and dead bands [1], period [steps]."""

    ticks: int
    gain_in: float
    integral_in: float
    gain_out: float
    integral_out: float
    limit: float
    band_off: float
    band_on: float
    filter_share: float


@njit(cache=True, inline="always")
def _root(dp: float) -> float:
    """Return the square root of a pressure difference with its sign, smooth at zero."""
    return float(dp / (dp * dp + 4e10) ** 0.25)


@njit(cache=True, inline="always")
def _friction(p: Press, u: float) -> float:
    level = p.coulomb + (p.breakaway - p.coulomb) * np.exp(-((u / p.stribeck) ** 2))
    return float(level * np.tanh(u / p.smooth))


@njit(cache=True, inline="always")
def _net_flow(p: Press, y_in: float, y_out: float, pressure: float) -> float:
    k = np.sqrt(2.0 / p.density)
    inflow = p.r_in * y_in * k * _root(p.supply - pressure)
    return float(
        inflow - p.r_out * y_out * k * _root(pressure) - p.leak * np.sqrt(max(pressure, 0.0))
    )


@njit(cache=True, inline="always")
def _opening(command: float, offset: float, saturation: float) -> float:
    v = max(command - offset, 0.0)
    return float(max(v * (1.0 - saturation * v), 0.0))


@njit(cache=True, inline="always")
def _rates(
    p: Press, x: float, u: float, pressure: float, y_in: float, y_out: float
) -> tuple[float, float, float]:
    force = p.area_bottom * pressure - p.area_top * p.supply - p.load
    force -= p.damping * u + _friction(p, u)
    if x < 0.0:
        force -= p.seat * x + p.seat_damping * min(u, 0.0)
    elif x > p.stroke:
        force -= p.seat * (x - p.stroke) + p.seat_damping * max(u, 0.0)
    held = max(pressure, _LEAST_P)
    room = p.volume + p.area_bottom * min(max(x, 0.0), p.stroke)
    stiffness = 1.0 / (room / p.bulk + p.gas * _P0 / (held + _P0) ** 2)
    flow = _net_flow(p, y_in, y_out, pressure) - p.area_bottom * u
    slope = stiffness * flow
    if pressure <= _LEAST_P and slope < 0.0:
        slope = 0.0
    return u, force / p.mass, slope


@njit(cache=True, inline="always")
def _control(memory: FloatArray, plc: Plc, error: float, hold: bool, period: float) -> float:
    """Return the signed command of a P(I) position controller that rests in a dead band."""
    resting = memory[1] > 0.5
    if hold and abs(error) < (plc.band_on if resting else plc.band_off):
        memory[0], memory[1] = 0.0, 1.0
        return 0.0
    memory[1] = 0.0
    kp, ki = (plc.gain_in, plc.integral_in) if error > 0.0 else (plc.gain_out, plc.integral_out)
    if memory[0] * error < 0.0:
        memory[0] = 0.0
    wanted = kp * error + ki * (memory[0] + error * period)
    if wanted > plc.limit:
        return float(plc.limit)
    if wanted < -plc.limit:
        return -float(plc.limit)
    memory[0] += error * period
    return float(wanted)


@njit(cache=True)
def run_cycle(
    state: FloatArray,
    memory: FloatArray,
    p: Press,
    plc: Plc,
    reference: FloatArray,
    noise: FloatArray,
    lost: FloatArray,
    stuck: bool,
) -> tuple[FloatArray, FloatArray]:
    """Run the press and its PLC over one production cycle.

    Parameters
    ----------
    state : (5,) array
        Position [m], speed [m/s], pressure [Pa], openings of the pilots [1]; written in place.
    memory : (6,) array
        Integral [s], then latch, filtered position, the two pilots' inputs behind their play
        [1]; written in place.
    p : Press
        Numbers of the press.
    plc : Plc
        Numbers of the controller.
    reference : (T,) array
        Wanted position at each PLC tick [1].
    noise : (T,) array
        Error of the controller's own position reading [1].
    lost : (T,) array
        Above 0.5 where the command of a tick does not reach the valve [1].
    stuck : bool
        Whether the spindle cannot move.

    Returns
    -------
    trace : (T * ticks * STEP_S / TRACE_S,) array
        Position at the beginning of each interval of TRACE_S [1].
    commands : (T, 2) array
        Command of each tick, inflow and outflow [1].
    """
    period = plc.ticks * STEP_S
    commands = np.zeros((len(reference), 2))
    trace = np.empty(len(reference) * plc.ticks // _PER_TRACE)
    x, u, pressure, y_in, y_out = state
    share_in = 1.0 - np.exp(-STEP_S / p.lag_in)
    share_out = 1.0 - np.exp(-STEP_S / p.lag_out)
    most = p.rate * STEP_S
    at = 0
    for tick in range(len(reference)):
        seen = x / p.stroke + noise[tick]
        memory[2] += plc.filter_share * (seen - memory[2])
        hold = tick > 0 and reference[tick] == reference[tick - 1]
        wanted = _control(memory, plc, reference[tick] - memory[2], hold, period)
        commands[tick, 0] = max(wanted, 0.0)
        commands[tick, 1] = max(-wanted, 0.0)
        gone = lost[tick] > 0.5
        v_in = 0.0 if gone else commands[tick, 0] * p.coil
        v_out = 0.0 if gone else commands[tick, 1]
        if v_in > 0.0:
            v_in = max(v_in + p.command_offset - p.preload, 0.0)
        if v_out > 0.0:
            v_out = max(v_out + p.command_offset, 0.0)
        half = 0.5 * p.play
        memory[3] = min(max(memory[3], v_in - half), v_in + half) if v_in > 0.0 else 0.0
        memory[4] = min(max(memory[4], v_out - half), v_out + half) if v_out > 0.0 else 0.0
        to_in = _opening(memory[3], p.offset_in, p.saturation_in)
        to_out = _opening(memory[4], p.offset_out, p.saturation_out)
        for _ in range(plc.ticks):
            if at % _PER_TRACE == 0:
                trace[at // _PER_TRACE] = x / p.stroke
            at += 1
            y_in += min(max((to_in - y_in) * share_in, -most), most)
            y_out += min(max((to_out - y_out) * share_out, -most), most)
            if stuck:
                u = 0.0
                continue
            h = STEP_S
            a1, b1, c1 = _rates(p, x, u, pressure, y_in, y_out)
            a2, b2, c2 = _rates(
                p, x + 0.5 * h * a1, u + 0.5 * h * b1, pressure + 0.5 * h * c1, y_in, y_out
            )
            a3, b3, c3 = _rates(
                p, x + 0.5 * h * a2, u + 0.5 * h * b2, pressure + 0.5 * h * c2, y_in, y_out
            )
            a4, b4, c4 = _rates(p, x + h * a3, u + h * b3, pressure + h * c3, y_in, y_out)
            x += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
            u += h / 6.0 * (b1 + 2.0 * b2 + 2.0 * b3 + b4)
            pressure += h / 6.0 * (c1 + 2.0 * c2 + 2.0 * c3 + c4)
            pressure = max(pressure, _LEAST_P)
    state[0], state[1], state[2], state[3], state[4] = x, u, pressure, y_in, y_out
    return trace, commands


@njit(cache=True)
def steady_speed(p: Press, v_in: float, v_out: float) -> float:
    """Return the speed at which the spindle moves under constant commands [stroke/s].

    Parameters
    ----------
    p : Press
        Numbers of the press.
    v_in, v_out : float
        Commands [1].
    """
    y_in = _opening(v_in, p.offset_in, p.saturation_in)
    y_out = _opening(v_out, p.offset_out, p.saturation_out)
    low, high = -5.0, 5.0
    for _ in range(80):
        u = 0.5 * (low + high)
        force = p.area_top * p.supply + p.load + p.damping * u + _friction(p, u)
        if _net_flow(p, y_in, y_out, force / p.area_bottom) > p.area_bottom * u:
            low = u
        else:
            high = u
    return float(0.5 * (low + high) / p.stroke)
