# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The thirteen equations of paper 003, (13) to (25), with corrected signs, and their Jacobian.

Corrected against the print: the structural damper acts against the piston's speed, the losses of
chamber 2 and of the fittings of the supply line act against their flows, the bracket of eq. (20)
is closed, the force turns the load about its arm, the fluid in the supply and return lines is
compressible besides the pipe, and the flow force is odd in x_v. SI units; pressures above
atmosphere; x_p counts from the middle of the stroke.
"""

from __future__ import annotations

from math import cos, sin, sqrt, tanh
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.physics import hysteresis
from valve_twin.core.physics.fluid import compressibility, smooth_root
from valve_twin.core.physics.friction import stop, stribeck
from valve_twin.core.valves.servo_system import numbers as n
from valve_twin.core.valves.servo_system.areas import ORIFICES, areas
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

IS, VV, XV, QS, PLS, P1, P2, VP, XP, OM, TH, PLR, QR = range(13)
STATES = 13
"""Motor current, valve speed and position, supply flow and pressure, chamber pressures, piston
speed and position, load speed and angle, return pressure and flow."""

FLOOR = np.array(
    [0.02, 0.02, 1e-4, 2e-5, 5e6, 5e6, 5e6, 0.05, 0.02, 0.5, 0.2, 5e5, 2e-5], dtype=np.float64
)
"""Size of each state below which the integrator's error counts absolutely, (13,)."""

WANTED, FED_BACK, HELD, LEAK = range(4)
CONTROLS = 4
"""Desired position [m], position that the controller has instead of x_p [m] (NaN = x_p), whether
the valve pipe is held (1), conductance of a leak from chamber 1 to return [m^3/s/sqrt(Pa)]."""

WORK = 3 * ORIFICES

_VALVE_ONSET, _PISTON_ONSET = 2e-6, 2e-4
"""Depth over which the stops of valve and piston come up [m]."""


@njit(cache=True, inline="always")
def motor(current: float, rate: float, p: FloatArray, memory: FloatArray) -> tuple[float, float]:
    """Return the motor's force [N] with hysteresis and saturation, and its slope [N/A].

    Parameters
    ----------
    current, rate : float
        Motor current [A] and its derivative [A/s].
    p, memory : (COUNT,), (PLAYS,) arrays
        Same as `evaluate` takes.
    """
    effective, slope = hysteresis.output(current, rate, memory, p[n.REACH], p[n.SHARE])
    turn = tanh(p[n.B] * effective / p[n.SATURATION])
    return p[n.SATURATION] * turn, p[n.B] * slope * (1.0 - turn * turn)


@njit(cache=True, inline="always")
def flows(y: FloatArray, p: FloatArray, w: FloatArray) -> None:
    """Write the flows of the five orifices [m^3/s] and their slopes over x_v and the drop.

    Parameters
    ----------
    y : (13,) array
        State, see `STATES`.
    p : (COUNT,) array
        Numbers, see `numbers`.
    w : (WORK,) array
        Overwritten: q1, q2, q3, q4, qL [m^3/s]; slopes over x_v [m^2/s]; slopes over the
        pressure drop [m^3/s/Pa].
    """
    area, slope = w[ORIFICES : 2 * ORIFICES], w[2 * ORIFICES :]
    areas(y[XV], p[n.RADIUS], p[n.CLEARANCE], p[n.U_S], p[n.U_R], area, slope)
    unit = sqrt(2.0 / p[n.RHO])
    for j in range(ORIFICES):
        if j == 0:
            drop = y[PLS] - y[P1]
        elif j == 1:
            drop = y[PLS] - y[P2]
        elif j == 2:
            drop = y[P1] - y[PLR]
        elif j == 3:
            drop = y[P2] - y[PLR]
        else:
            drop = y[PLS] - y[PLR]
        root, root_slope = smooth_root(drop, p[n.LINEAR])
        gain = unit * (p[n.CDL] if j == ORIFICES - 1 else p[n.CD])
        opening = area[j]
        w[j] = gain * opening * root
        area[j], slope[j] = gain * slope[j] * root, gain * opening * root_slope


@njit(cache=True, inline="always")
def command(y: FloatArray, p: FloatArray, u: FloatArray, force: float) -> tuple[float, bool]:
    """Return the desired current of the three loops, eq. (12) [A], and whether it is not limited.

    Paper 003 adds the number 1 to a gain in A/N; here k_f F_nominal / i_limit stands beside it.

    Parameters
    ----------
    y, p, u : (13,), (COUNT,), (CONTROLS,) arrays
        Same as `evaluate` takes.
    force : float
        Force that is fed back [N].
    """
    position = y[XP] if np.isnan(u[FED_BACK]) else u[FED_BACK]
    outer = p[n.KP] * (u[WANTED] - position) - p[n.KVEL] * y[VP]
    wanted = p[n.OUTER] * outer - p[n.KF] * force
    limited = min(max(wanted, -p[n.LIMIT]), p[n.LIMIT])
    return limited, limited == wanted


@njit(cache=True, inline="always")
def _valve(
    y: FloatArray, p: FloatArray, memory: FloatArray, u: FloatArray, w: FloatArray,
    dy: FloatArray, jac: FloatArray, want: bool,
) -> None:  # fmt: skip
    """Motor and valve pipe, eqs. (13) to (15); x_L and F_s come with the loops."""
    sine, cosine = sin(y[TH]), cos(y[TH])
    force = p[n.KS] * (y[XP] - p[n.ARM] * sine) + p[n.BS] * (y[VP] - p[n.ARM] * y[OM] * cosine)
    wanted, free = command(y, p, u, force)
    dy[IS] = (p[n.KIF] * (wanted - p[n.KIB] * y[IS]) - p[n.RE] * y[IS] - p[n.B] * y[VV]) / p[n.LE]
    push, push_i = motor(y[IS], dy[IS], p, memory)
    x = y[XV]
    flow_sum = abs(w[0]) + abs(w[3]) - abs(w[1]) - abs(w[2])
    near = sqrt(abs(x) + p[n.K1])
    against, against_x = stop(x, p[n.TRAVEL], p[n.VALVE_STOP], _VALVE_ONSET)
    pull = p[n.KV] * x + against + p[n.KQ] * flow_sum / near
    held = u[HELD] > 0.0
    dy[VV] = 0.0 if held else (push - p[n.BV] * y[VV] - pull) / p[n.MV]
    dy[XV] = 0.0 if held else y[VV]
    if not want:
        return
    jac[IS, IS] = -(p[n.KIF] * p[n.KIB] + p[n.RE]) / p[n.LE]
    jac[IS, VV] = -p[n.B] / p[n.LE]
    if free:
        k = p[n.KIF] / p[n.LE]
        lever, turn = p[n.ARM] * cosine, p[n.ARM] * y[OM] * sine
        jac[IS, VP] = k * (-p[n.OUTER] * p[n.KVEL] - p[n.KF] * p[n.BS])
        fed = p[n.OUTER] * p[n.KP] if np.isnan(u[FED_BACK]) else 0.0
        jac[IS, XP] = k * (-fed - p[n.KF] * p[n.KS])
        jac[IS, OM] = k * p[n.KF] * p[n.BS] * lever
        jac[IS, TH] = k * p[n.KF] * (p[n.KS] * lever - p[n.BS] * turn)
    if held:
        return
    m = p[n.MV]
    jac[VV, IS] = push_i / m
    jac[VV, VV] = -p[n.BV] / m
    s1, s2 = np.sign(w[0]), np.sign(w[1])
    s3, s4 = np.sign(w[2]), np.sign(w[3])
    g = p[n.KQ] / (near * m)
    by_x = s1 * w[5] + s4 * w[8] - s2 * w[6] - s3 * w[7]
    bend = 0.5 * flow_sum / (abs(x) + p[n.K1]) * np.sign(x)
    jac[VV, XV] = -(p[n.KV] + against_x) / m - g * (by_x - bend)
    jac[VV, PLS] = -g * (s1 * w[10] - s2 * w[11])
    jac[VV, P1] = -g * (-s1 * w[10] - s3 * w[12])
    jac[VV, P2] = -g * (s4 * w[13] + s2 * w[11])
    jac[VV, PLR] = -g * (-s4 * w[13] + s3 * w[12])
    jac[XV, VV] = 1.0


@njit(cache=True, inline="always")
def _lines(
    y: FloatArray, p: FloatArray, w: FloatArray, dy: FloatArray, jac: FloatArray, want: bool
) -> None:
    """Supply and return line, eqs. (16), (17), (24), (25), pipe and fluid both compliant."""
    q_s, q_r = y[QS], y[QR]
    dy[QS] = (p[n.PS] - p[n.R_S] * q_s - p[n.M_S] * q_s * abs(q_s) - y[PLS]) / p[n.I_S]
    dy[QR] = (y[PLR] - p[n.PR] - p[n.R_R] * q_r - p[n.M_R] * q_r * abs(q_r)) / p[n.I_R]
    soft_s, soft_s_p = compressibility(y[PLS], p[n.BULK], p[n.AIR])
    soft_r, soft_r_p = compressibility(y[PLR], p[n.BULK], p[n.AIR])
    c_s = p[n.V_S] * (p[n.C_LINE] + soft_s)
    c_r = p[n.V_R] * (p[n.C_LINE] + soft_r)
    dy[PLS] = (q_s - w[4] - w[0] - w[1]) / c_s
    dy[PLR] = (w[4] + w[2] + w[3] - q_r) / c_r
    if not want:
        return
    jac[QS, QS] = -(p[n.R_S] + 2.0 * p[n.M_S] * abs(q_s)) / p[n.I_S]
    jac[QS, PLS] = -1.0 / p[n.I_S]
    jac[QR, QR] = -(p[n.R_R] + 2.0 * p[n.M_R] * abs(q_r)) / p[n.I_R]
    jac[QR, PLR] = 1.0 / p[n.I_R]
    jac[PLS, QS] = 1.0 / c_s
    jac[PLS, XV] = -(w[9] + w[5] + w[6]) / c_s
    jac[PLS, PLS] = -(w[14] + w[10] + w[11]) / c_s - dy[PLS] * p[n.V_S] * soft_s_p / c_s
    jac[PLS, P1], jac[PLS, P2], jac[PLS, PLR] = w[10] / c_s, w[11] / c_s, w[14] / c_s
    jac[PLR, QR] = -1.0 / c_r
    jac[PLR, XV] = (w[9] + w[7] + w[8]) / c_r
    jac[PLR, PLR] = -(w[14] + w[12] + w[13]) / c_r - dy[PLR] * p[n.V_R] * soft_r_p / c_r
    jac[PLR, P1], jac[PLR, P2], jac[PLR, PLS] = w[12] / c_r, w[13] / c_r, w[14] / c_r


@njit(cache=True, inline="always")
def _chambers(
    y: FloatArray, p: FloatArray, u: FloatArray, w: FloatArray,
    dy: FloatArray, jac: FloatArray, want: bool,
) -> None:  # fmt: skip
    """Pressures on both sides of the piston, eqs. (18) and (19)."""
    root, root_slope = smooth_root(y[P1] - y[PLR], p[n.LINEAR])
    lost, lost_p = u[LEAK] * root, u[LEAK] * root_slope
    base = 0.5 * p[n.STROKE] + p[n.DEAD]
    room_1 = p[n.AREA_1] * (base + y[XP]) + p[n.V_1]
    room_2 = p[n.AREA_2] * (base - y[XP]) + p[n.V_2]
    soft_1, soft_1_p = compressibility(y[P1], p[n.BULK], p[n.AIR])
    soft_2, soft_2_p = compressibility(y[P2], p[n.BULK], p[n.AIR])
    c_1 = p[n.C_1] + room_1 * soft_1
    c_2 = p[n.C_2] + room_2 * soft_2
    dy[P1] = (w[0] - w[2] - lost - p[n.AREA_1] * y[VP]) / c_1
    dy[P2] = (w[1] - w[3] + p[n.AREA_2] * y[VP]) / c_2
    if not want:
        return
    jac[P1, XV] = (w[5] - w[7]) / c_1
    jac[P1, PLS], jac[P1, PLR] = w[10] / c_1, (w[12] + lost_p) / c_1
    jac[P1, P1] = -(w[10] + w[12] + lost_p) / c_1 - dy[P1] * room_1 * soft_1_p / c_1
    jac[P1, VP] = -p[n.AREA_1] / c_1
    jac[P1, XP] = -dy[P1] * p[n.AREA_1] * soft_1 / c_1
    jac[P2, XV] = (w[6] - w[8]) / c_2
    jac[P2, PLS], jac[P2, PLR] = w[11] / c_2, w[13] / c_2
    jac[P2, P2] = -(w[11] + w[13]) / c_2 - dy[P2] * room_2 * soft_2_p / c_2
    jac[P2, VP] = p[n.AREA_2] / c_2
    jac[P2, XP] = dy[P2] * p[n.AREA_2] * soft_2 / c_2


@njit(cache=True, inline="always")
def _mechanics(y: FloatArray, p: FloatArray, dy: FloatArray, jac: FloatArray, want: bool) -> None:
    """Piston and load, eqs. (20) to (23); the end covers are stiff springs."""
    v, sine, cosine = y[VP], sin(y[TH]), cos(y[TH])
    lever = p[n.ARM] * cosine
    force = p[n.KS] * (y[XP] - p[n.ARM] * sine) + p[n.BS] * (v - lever * y[OM])
    rub, rub_v = stribeck(v, p[n.COULOMB], p[n.STATIC], p[n.VISCOUS], p[n.CREEP], p[n.DECAY])
    against, against_x = stop(y[XP], 0.5 * p[n.STROKE], p[n.PISTON_STOP], _PISTON_ONSET)
    line, fit = p[n.LINE], p[n.FITTINGS]
    push = p[n.AREA_1] * y[P1] - p[n.AREA_2] * y[P2]
    dy[VP] = (push - force - rub - against - line * v - fit * v * abs(v)) / p[n.MASS]
    dy[XP] = v
    dy[OM] = (lever * force - p[n.BG] * y[OM] + p[n.TORQUE]) / p[n.INERTIA]
    dy[TH] = y[OM]
    if not want:
        return
    by_th = -p[n.KS] * lever + p[n.BS] * p[n.ARM] * y[OM] * sine
    m, i = p[n.MASS], p[n.INERTIA]
    jac[VP, P1], jac[VP, P2] = p[n.AREA_1] / m, -p[n.AREA_2] / m
    jac[VP, VP] = -(p[n.BS] + rub_v + line + 2.0 * fit * abs(v)) / m
    jac[VP, XP] = -(p[n.KS] + against_x) / m
    jac[VP, OM], jac[VP, TH] = p[n.BS] * lever / m, -by_th / m
    jac[XP, VP] = 1.0
    jac[OM, VP], jac[OM, XP] = lever * p[n.BS] / i, lever * p[n.KS] / i
    jac[OM, OM] = (-lever * p[n.BS] * lever - p[n.BG]) / i
    jac[OM, TH] = (lever * by_th - p[n.ARM] * sine * force) / i
    jac[TH, OM] = 1.0


@njit(cache=True)
def evaluate(
    y: FloatArray, p: FloatArray, memory: FloatArray, u: FloatArray, w: FloatArray,
    dy: FloatArray, jac: FloatArray, want: bool,
) -> None:  # fmt: skip
    """Write the derivative of the state, and its Jacobian where it is wanted.

    Parameters
    ----------
    y : (13,) array
        State; see `STATES`.
    p : (COUNT,) array
        Numbers; see `numbers`.
    memory : (PLAYS,) array
        Of the motor's hysteresis, since when the current has been monotone [A].
    u : (CONTROLS,) array
        What acts from outside, see `CONTROLS`.
    w : (WORK,) array
        Overwritten with the flows, see `flows`.
    dy : (13,) array
        Overwritten [unit of each state / s].
    jac : (13, 13) array
        Overwritten if `want`.
    want : bool
        Whether the Jacobian is wanted.
    """
    if want:
        jac[:, :] = 0.0
    flows(y, p, w)
    _valve(y, p, memory, u, w, dy, jac, want)
    _lines(y, p, w, dy, jac, want)
    _chambers(y, p, u, w, dy, jac, want)
    _mechanics(y, p, dy, jac, want)
