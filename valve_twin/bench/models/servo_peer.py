# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The servosystem of paper 003 as a user would write it for scipy: a plain function of 13 states.

Written from the equations on their own, without the compiled functions, and without hysteresis,
which a solver of ordinary differential equations cannot remember. Tests compare the two.
"""

from __future__ import annotations

from math import acos, cos, exp, pi, pow, sin, sqrt, tanh
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.servo_system.plant import ServoSystemPlant


def loop(n: ServoSystemPlant, wanted: float) -> Callable[[float, FloatArray], FloatArray]:
    """Return the right-hand side (t, y) -> y' of the closed loop.

    Parameters
    ----------
    n : ServoSystemPlant
        Its numbers.
    wanted : float
        Desired position, from the middle of the stroke [m].
    """
    area = pi * n.line_bore**2 / 4
    wall = n.line_bore / (n.line_modulus * n.line_wall)

    def flow(coefficient: float, opening: float, drop: float) -> float:
        smooth = sqrt(sqrt(drop * drop + n.linear_pressure**2))
        return coefficient * opening * sqrt(2 / n.density) * drop / smooth

    def compliance(pressure: float) -> float:
        total = pressure + 1.013e5
        air = n.air_share * pow(1.013e5 / total, 1 / 1.4) / (1.4 * total)
        return 1 / n.bulk_modulus + air

    def loss(length: float, fittings: float, q: float) -> float:
        laminar = 128 * n.viscosity * length * q / (pi * n.line_bore**4)
        return laminar + fittings * n.density * q * abs(q) / (2 * area**2)

    def supply_opening(x: float) -> tuple[float, float]:
        r = n.port_radius
        d = min(max(2 * r - x - n.supply_underlap, 0.0), 2 * r)
        angle = acos(d / (2 * r))
        return 8 * r * n.clearance * angle, 8 * r**2 * angle - 2 * d * sqrt(4 * r**2 - d**2)

    def return_opening(x: float) -> float:
        r = n.port_radius
        s = min(max(n.return_underlap - x, 0.0), 2 * r)
        return 4 * (r**2 * acos((r - s) / r) - (r - s) * sqrt(2 * r * s - s**2))

    def derivative(_: float, y: FloatArray) -> FloatArray:
        i, v_v, x_v, q_s, p_ls, p_1, p_2, v_p, x_p, omega, theta, p_lr, q_r = y.tolist()
        strip_1, lens_1 = supply_opening(x_v)
        strip_2, lens_2 = supply_opening(-x_v)
        strip = 8 * pi * n.port_radius * n.clearance
        q_1 = flow(n.discharge, strip_1 + lens_1, p_ls - p_1)
        q_2 = flow(n.discharge, strip_2 + lens_2, p_ls - p_2)
        q_3 = flow(n.discharge, strip - strip_1 + return_opening(x_v), p_1 - p_lr)
        q_4 = flow(n.discharge, strip - strip_2 + return_opening(-x_v), p_2 - p_lr)
        q_l = flow(n.leak_discharge, strip - strip_1 - strip_2, p_ls - p_lr)
        x_l, v_l = n.arm * sin(theta), omega * n.arm * cos(theta)
        force = n.structural_stiffness * (x_p - x_l) + n.structural_damping * (v_p - v_l)
        outer = n.position_gain * (wanted - x_p) - n.velocity_gain * v_p
        i_d = (1 + n.force_gain * n.nominal_force / n.current_limit) * outer
        i_d = min(max(i_d - n.force_gain * force, -n.current_limit), n.current_limit)
        volts = n.current_gain * (i_d - n.current_feedback * i) - n.resistance * i
        push = n.motor_force * tanh(n.motor_gain * i / n.motor_force)
        q_odd = abs(q_1) + abs(q_4) - abs(q_2) - abs(q_3)
        f_q = n.flow_force * q_odd / sqrt(abs(x_v) + n.flow_force_offset)
        damping = 2 * n.valve_damping_ratio * sqrt(n.valve_stiffness * n.valve_mass)
        beyond = abs(x_v) - n.valve_travel
        stop = 30 * n.valve_stiffness * beyond**2 / (beyond + 2e-6) if beyond > 0 else 0.0
        half = n.stroke / 2 + n.dead_length
        line_1, line_2 = area * n.length_1, area * n.length_2
        c_1 = line_1 * wall + (n.area_1 * (half + x_p) + line_1) * compliance(p_1)
        c_2 = line_2 * wall + (n.area_2 * (half - x_p) + line_2) * compliance(p_2)
        c_s = area * n.supply_length * (wall + compliance(p_ls))
        c_r = area * n.return_length * (wall + compliance(p_lr))
        bell = (n.static_friction - n.coulomb_friction) * exp(-((v_p / n.decay_speed) ** 2))
        rub = (n.coulomb_friction + bell) * tanh(v_p / n.creep_speed) + n.viscous_friction * v_p
        push_1 = n.area_1 * (p_1 - loss(n.length_1, n.piston_losses, n.area_1 * v_p))
        push_2 = n.area_2 * (p_2 + loss(n.length_2, n.piston_losses, n.area_2 * v_p))
        fluid = n.density / area * (n.length_1 * n.area_1**2 + n.length_2 * n.area_2**2)
        inertance = n.density / area
        turn = n.arm * force * cos(theta) - n.load_damping * omega + n.load_torque
        supply = n.supply_pressure - loss(n.supply_length, n.supply_losses, q_s) - p_ls
        back = p_lr - n.return_pressure - loss(n.return_length, n.return_losses, q_r)
        return np.array(
            [
                (volts - n.motor_gain * v_v) / n.inductance,
                (push - damping * v_v - n.valve_stiffness * x_v - np.sign(x_v) * stop - f_q)
                / n.valve_mass,
                v_v,
                supply / (inertance * n.supply_length),
                (q_s - q_l - q_1 - q_2) / c_s,
                (q_1 - q_3 - n.area_1 * v_p) / c_1,
                (q_2 - q_4 + n.area_2 * v_p) / c_2,
                (push_1 - push_2 - force - rub) / (n.piston_mass + fluid),
                v_p,
                turn / n.load_inertia,
                omega,
                (q_l + q_3 + q_4 - q_r) / c_r,
                back / (inertance * n.return_length),
            ]
        )

    return derivative
