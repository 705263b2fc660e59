# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled motion of the double-solenoid valve, explicit Euler at 80 kHz (paper 000, eq. (5)).

    psi_A' = V_A - R_A i_A      i_A = G_A i_s(psi_A, i_B, x)      coil B mirrored, x -> -x
    F = G_F g [F_s(i_A, x) - F_s(i_B, -x)]
    m v' = F + spring_1(x) - spring_2(x) - F_f(v)      x' = v

With the next order, `Eddies`, two branches of eddy currents stand in place of G_A and G_F.

The currents of the two coils depend on each other at the same instant; each takes the other's
current of the sub-step before, both alike, so that the mirrored valve gives the mirrored bits.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from valve_twin.core.control import current_loop
from valve_twin.core.control.current_loop import (
    SUB_STEPS,
    CurrentGains,
    current_control,
    integrate_error,
    level_at,
    mean_voltage,
    positive_steps,
)
from valve_twin.core.physics.curves import locate, static_currents, static_force
from valve_twin.core.valves.double_solenoid.eddies import driving, step_branches
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.physics.curves import Curves
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.double_solenoid.eddies import Eddies

POSITION, X, SPEED, PSI_A, PSI_B = 0, 1, 2, 3, 4
GA_1, GA_2, GB_1, GB_2, GF_1, GF_2 = 5, 6, 7, 8, 9, 10
I_A, I_B, MEAN_A, MEAN_B, VOLTS_A, VOLTS_B = 11, 12, 13, 14, 15, 16
LEVEL_A, LEVEL_B, CARRY_A, CARRY_B, INTEGRAL_A, INTEGRAL_B = 17, 18, 19, 20, 21, 22
COMMAND, PID_INTEGRAL, READ, FORCE, FAILED, TIME = 23, 24, 25, 26, 27, 28
LOG_VOLTS_A, LOG_VOLTS_B, LOG_A, LOG_B, PUSH = 29, 30, 31, 32, 33
STATE_SIZE = 34
"""Position [1]; x [m], speed [m/s], flux linkages [Wb]; states of G_A, G_B, G_F; currents of the
last sub-step, their means over the last sample [A]; mean voltages of the last sample [V]; levels
of the bridges [1], voltage not yet delivered and integral parts of the current controllers [V];
output of the position controller and its integral part [1], last position read [m]; force [N]; 1
after a value that is not finite; time [s]; what is logged: mean voltages [V] and
currents [A] of the last logged sample; force from outside on the spool [N]. With `Eddies` the
states of G_A and G_B are the branches of either coil, those of G_F the currents that magnetise
[A]."""

STEP_S = current_loop.STEP_S
"""Step of the integration: an eighth of a control sample [s]; paper 000, section 2.2."""

SAMPLE_S = current_loop.SAMPLE_S


class Second(NamedTuple):
    """A transfer function (1 + b1 s + b2 s^2)/(1 + a1 s + a2 s^2) in controllable form."""

    rate_1: float
    rate_2: float
    out_1: float
    out_2: float
    direct: float


AT_ONCE = Second(0.0, 0.0, 0.0, 0.0, 1.0)
"""G = 1: what comes out is what goes in."""


class Valve(NamedTuple):
    """Numbers of coils and mechanics, SI units."""

    resistance_a: float
    resistance_b: float
    current: Second
    force: Second
    eddies: Eddies
    force_gain: float
    mass: float
    preload_1: float
    preload_2: float
    spring_1: float
    spring_2: float
    friction: float
    alpha: float
    beta: float
    stop: float
    half_stroke: float
    bias: float
    span: float
    largest: float


def second_order(b1: float, b2: float, a1: float, a2: float) -> Second:
    """Return G(s) = (1 + b1 s + b2 s^2)/(1 + a1 s + a2 s^2) as the compiled functions take it.

    States z1' = z2, z2' = (u - z1 - a1 z2)/a2, output (b0 - D) z1 + (b1 - D a1) z2 + D u with
    D = b2/a2; equations.md 5.1. Coefficients in s and s^2.

    Parameters
    ----------
    b1, b2 : float
        Coefficients of the numerator [s], [s^2].
    a1, a2 : float
        Coefficients of the denominator [s], [s^2].
    """
    direct = b2 / a2
    return Second(1.0 / a2, a1 / a2, 1.0 - direct, b1 - direct * a1, direct)


@njit(cache=True)
def friction_force(v: Valve, speed: float) -> float:
    """Return F_h/(1 + exp(-alpha v)) - F_h/2 + beta v [N]; paper 000, eq. (2).

    Written with the exponential of the magnitude: odd to the last bit, and it cannot overflow.
    """
    left = math.exp(-v.alpha * abs(speed))
    level = 0.5 * v.friction * (1.0 - left) / (1.0 + left)
    return math.copysign(level, speed) + v.beta * speed


@njit(cache=True)
def spring_force(v: Valve, x: float) -> float:
    """Return the force of both one-sided preloaded springs [N]."""
    return max(v.preload_1 - v.spring_1 * x, 0.0) - max(v.preload_2 + v.spring_2 * x, 0.0)


@njit(cache=True, error_model="numpy", forceinline=True)
def step_sample(
    s: FloatArray,
    v: Valve,
    m: Curves,
    volts: tuple[float, float],
    up: tuple[int, int],
    steps: int,
    stuck: bool,
) -> None:
    """Advance the state (STATE_SIZE,) by a control sample.

    Parameters
    ----------
    s : (STATE_SIZE,) array
        See `STATE_SIZE`; written in place.
    v, m : Valve, Curves
        Numbers of the valve, curves of a coil.
    volts : tuple of float
        Voltage of each bridge: its supply, or with `up` below 0 its mean [V].
    up : tuple of int
        Positive ones of the 8 sub-steps of either bridge; below 0 = the bridges give their means.
    steps : int
        Steps of the integration: 8; fewer for a prediction.
    stuck : bool
        The spool does not move.
    """
    h = SAMPLE_S / steps
    switched = up[0] >= 0
    x, speed, psi_a, psi_b = s[X], s[SPEED], s[PSI_A], s[PSI_B]
    a1, a2, b1, b2, f1, f2 = s[GA_1], s[GA_2], s[GB_1], s[GB_2], s[GF_1], s[GF_2]
    i_a, i_b, push = s[I_A], s[I_B], s[PUSH]
    sum_a, sum_b, force, static = 0.0, 0.0, 0.0, 0.0
    c, g = v.current, v.force
    level_a, level_b = 1.0, 1.0
    per_mass = 1.0 / v.mass
    eddy = v.eddies
    linked = eddy.gain_1 > 0.0
    for k in range(steps):
        if switched:
            level_a = level_at(s[LEVEL_A], up[0], k)
            level_b = level_at(s[LEVEL_B], up[1], k)
        place = locate(m, x)
        if linked:
            stat_a, stat_b = static_currents(m, (psi_a, psi_b), (f1, f2), place)
            f1, f2 = stat_a, stat_b
            i_a, i_b = stat_a + a1 + a2, stat_b + b1 + b2
            force = v.force_gain * static_force(m, stat_a, stat_b, place)
        else:
            stat_a, stat_b = static_currents(m, (psi_a, psi_b), (i_a, i_b), place)
            i_a = c.out_1 * a1 + c.out_2 * a2 + c.direct * stat_a
            i_b = c.out_1 * b1 + c.out_2 * b2 + c.direct * stat_b
            static = v.force_gain * static_force(m, i_a, i_b, place)
            force = g.out_1 * f1 + g.out_2 * f2 + g.direct * static
        sum_a += i_a
        sum_b += i_b
        accel = (force + spring_force(v, x) - friction_force(v, speed) + push) * per_mass
        induced_a = volts[0] * level_a - v.resistance_a * i_a
        induced_b = volts[1] * level_b - v.resistance_b * i_b
        psi_a += h * induced_a
        psi_b += h * induced_b
        if linked:
            a1, a2 = step_branches(eddy, a1, a2, driving(eddy, stat_a, induced_a), h)
            b1, b2 = step_branches(eddy, b1, b2, driving(eddy, stat_b, induced_b), h)
        else:
            a1, a2 = a1 + h * a2, a2 + h * (c.rate_1 * (stat_a - a1) - c.rate_2 * a2)
            b1, b2 = b1 + h * b2, b2 + h * (c.rate_1 * (stat_b - b1) - c.rate_2 * b2)
            f1, f2 = f1 + h * f2, f2 + h * (g.rate_1 * (static - f1) - g.rate_2 * f2)
        if stuck:
            speed = 0.0
            continue
        x += h * speed
        speed += h * accel
        if x > v.stop:
            x, speed = v.stop, min(speed, 0.0)
        elif x < -v.stop:
            x, speed = -v.stop, max(speed, 0.0)
    s[X], s[SPEED], s[PSI_A], s[PSI_B] = x, speed, psi_a, psi_b
    s[GA_1], s[GA_2], s[GB_1], s[GB_2], s[GF_1], s[GF_2] = a1, a2, b1, b2, f1, f2
    s[I_A], s[I_B], s[FORCE] = i_a, i_b, force
    s[MEAN_A], s[MEAN_B] = sum_a / steps, sum_b / steps
    if switched:
        s[LEVEL_A], s[LEVEL_B] = level_a, level_b
    s[POSITION] = 0.5 * (x / v.half_stroke + 1.0)
    s[TIME] += SAMPLE_S
    if not math.isfinite(x + speed + psi_a + psi_b + i_a + i_b + force):
        s[FAILED] = 1.0


@njit(cache=True)
def wanted_current(v: Valve, command: float, side: float) -> float:
    """Return the reference of a coil's current [A].

    Parameters
    ----------
    v : Valve
        Numbers of the valve.
    command : float
        Output of the position controller, -1..1 [1].
    side : float
        The coil: +1 = A, -1 = B [1].
    """
    return min(max(v.bias + side * v.span * command, 0.0), v.largest)


@njit(cache=True)
def drive_coil(
    s: FloatArray, g: CurrentGains, wanted: float, mean: int, integral: int, carry: int
) -> int:
    """Run one current controller and its modulator; return the positive sub-steps.

    What the 9 mean voltages cannot give is carried over to the next sample.

    Parameters
    ----------
    s : (STATE_SIZE,) array
        See `STATE_SIZE`; written in place.
    g : CurrentGains
        Numbers of the controller.
    wanted : float
        Reference [A].
    mean, integral, carry : int
        Where measured current, integral part and carried voltage of the coil stand in `s`.
    """
    voltage = current_control(g, wanted, s[mean], s[integral])
    s[integral] = integrate_error(g, wanted, s[mean], s[integral], voltage)
    limited = min(max(voltage, -g.supply), g.supply) + s[carry]
    up = positive_steps(limited, g.supply)
    left = limited - mean_voltage(up, g.supply)
    quantum = g.supply / SUB_STEPS
    s[carry] = min(max(left, -quantum), quantum)
    return up


@njit(cache=True)
def control_sample(
    s: FloatArray, v: Valve, m: Curves, g: CurrentGains, command: float, stuck: bool
) -> None:
    """Run current controllers, bridges and plant for one control sample.

    Parameters
    ----------
    s : (STATE_SIZE,) array
        See `STATE_SIZE`; written in place.
    v, m, g : Valve, Curves, CurrentGains
        The valve and its current controllers.
    command : float
        Output of the position controller, -1..1 [1].
    stuck : bool
        The spool does not move.
    """
    up_a = drive_coil(s, g, wanted_current(v, command, 1.0), MEAN_A, INTEGRAL_A, CARRY_A)
    up_b = drive_coil(s, g, wanted_current(v, command, -1.0), MEAN_B, INTEGRAL_B, CARRY_B)
    s[VOLTS_A] = mean_voltage(up_a, g.supply)
    s[VOLTS_B] = mean_voltage(up_b, g.supply)
    step_sample(s, v, m, (g.supply, g.supply), (up_a, up_b), SUB_STEPS, stuck)
    s[COMMAND] = command


@njit(cache=True, forceinline=True)
def predict_sample(
    s: FloatArray, v: Valve, m: Curves, g: CurrentGains, command: float, steps: int
) -> None:
    """Run `control_sample` with bridges that give their mean voltage, in fewer steps.

    Parameters
    ----------
    s : (STATE_SIZE,) array
        See `STATE_SIZE`; written in place.
    v, m, g : Valve, Curves, CurrentGains
        The valve and its current controllers.
    command : float
        Output of the position controller, -1..1 [1].
    steps : int
        Steps of the integration.
    """
    wanted_a, wanted_b = wanted_current(v, command, 1.0), wanted_current(v, command, -1.0)
    volts_a = current_control(g, wanted_a, s[MEAN_A], s[INTEGRAL_A])
    volts_b = current_control(g, wanted_b, s[MEAN_B], s[INTEGRAL_B])
    s[INTEGRAL_A] = integrate_error(g, wanted_a, s[MEAN_A], s[INTEGRAL_A], volts_a)
    s[INTEGRAL_B] = integrate_error(g, wanted_b, s[MEAN_B], s[INTEGRAL_B], volts_b)
    volts_a = min(max(volts_a, -g.supply), g.supply)
    volts_b = min(max(volts_b, -g.supply), g.supply)
    step_sample(s, v, m, (volts_a, volts_b), (-1, -1), steps, False)
