# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The physical numbers of the servosystem in the order of the compiled functions.

The compiled functions take one array: the estimation changes its entries, `derive` then renews
what follows from them.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import pi
from typing import TYPE_CHECKING

from valve_twin.core.physics.fluid import fittings, laminar
from valve_twin.core.physics.hysteresis import mean_reach
from valve_twin.core.quantity import assumed
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray


@dataclass(frozen=True, slots=True)
class PhysicalNumbers:
    """Numbers of the data sheet in the order of the compiled functions."""

    supply_pressure: float = assumed(20.7e6, "Pa", "Pressure of the supply (P_s)", 1e5, 1e8)
    return_pressure: float = assumed(0.35e6, "Pa", "Pressure of the return (P_r)", 0.0, 1e8)
    density: float = assumed(860.0, "kg/m^3", "Density of the fluid (rho)", 500.0, 2000.0)
    viscosity: float = assumed(0.014, "Pa s", "Viscosity of the fluid (mu)", 1e-4, 10.0)
    bulk_modulus: float = assumed(1e9, "Pa", "Bulk modulus without air (beta)", 1e8, 1e10)
    air_share: float = assumed(0.002, "1", "Entrained air, share at atmosphere", 0.0, 0.2)
    line_bore: float = assumed(4.6e-3, "m", "Bore of all lines (d)", 1e-4, 0.1)
    line_wall: float = assumed(0.9e-3, "m", "Wall of all lines (t_w)", 1e-4, 0.1)
    line_modulus: float = assumed(190e9, "Pa", "Elastic modulus of the lines (E)", 1e6, 1e12)
    supply_length: float = assumed(1.5, "m", "Length of the supply line (l_s)", 0.01, 100.0)
    return_length: float = assumed(1.5, "m", "Length of the return line (l_r)", 0.01, 100.0)
    length_1: float = assumed(0.3, "m", "Line to chamber 1 (l_1)", 1e-3, 10.0)
    length_2: float = assumed(0.3, "m", "Line to chamber 2 (l_2)", 1e-3, 10.0)
    supply_losses: float = assumed(4.0, "1", "Fittings of the supply line (sum k_s)", 0.0, 1e3)
    return_losses: float = assumed(4.0, "1", "Fittings of the return line (sum k_r)", 0.0, 1e3)
    piston_losses: float = assumed(3.0, "1", "Fittings of each chamber's line", 0.0, 1e3)
    area_1: float = assumed(3.14e-4, "m^2", "Piston area of chamber 1 (A_p1)", 1e-6, 1.0)
    area_2: float = assumed(2.36e-4, "m^2", "Piston area of chamber 2 (A_p2)", 1e-6, 1.0)
    stroke: float = assumed(0.08, "m", "Travel of the piston, stands for 1", 1e-3, 10.0)
    dead_length: float = assumed(2e-3, "m", "Room left in a chamber at its end", 1e-5, 1.0)
    piston_mass: float = assumed(0.35, "kg", "Mass of the piston (m_p)", 1e-3, 1e4)
    coulomb_friction: float = assumed(
        25.0, "N", "Friction of the piston's seals in motion", 0.0, 1e5
    )
    static_friction: float = assumed(40.0, "N", "Break-away force of the seals", 0.0, 1e5)
    viscous_friction: float = assumed(60.0, "N s/m", "Viscous friction of the piston", 0.0, 1e6)
    creep_speed: float = assumed(2e-3, "m/s", "Speed over which friction turns", 1e-5, 1.0)
    decay_speed: float = assumed(1e-2, "m/s", "Speed over which break-away falls", 1e-4, 1.0)
    structural_stiffness: float = assumed(1.5e6, "N/m", "Member to the load (k_s)", 1e3, 1e10)
    structural_damping: float = assumed(600.0, "N s/m", "Damping of the member (b_s)", 0.0, 1e6)
    load_inertia: float = assumed(0.15, "kg m^2", "Inertia of the load (I_L)", 1e-4, 1e4)
    arm: float = assumed(0.08, "m", "Lever arm of the load (l_a)", 1e-3, 10.0)
    load_damping: float = assumed(0.6, "N m s/rad", "Damping of the load (b_g)", 0.0, 1e5)
    load_torque: float = assumed(0.0, "N m", "Torque on the load from outside", -1e5, 1e5)
    port_radius: float = assumed(0.35e-3, "m", "Radius of the orifices (r)", 1e-5, 0.05)
    clearance: float = assumed(4e-6, "m", "Clearance at the pipe tip (c)", 1e-7, 1e-3)
    supply_underlap: float = assumed(8e-6, "m", "Underlap of supply orifices (u_s)", 0.0, 0.1)
    return_underlap: float = assumed(12e-6, "m", "Underlap of return orifices (u_r)", 0.0, 0.1)
    valve_travel: float = assumed(220e-6, "m", "Travel of the pipe to a stop", 1e-6, 0.05)
    valve_mass: float = assumed(2e-3, "kg", "Moving mass of the valve (m_v)", 1e-6, 10.0)
    valve_stiffness: float = assumed(3822.0, "N/m", "Pipe and magnet together (k_v)", 1.0, 1e8)
    valve_damping_ratio: float = assumed(
        1.0, "1", "Damping of the valve over critical", 0.01, 10.0
    )
    discharge: float = assumed(0.62, "1", "Discharge of the four orifices (C_d)", 0.05, 1.5)
    leak_discharge: float = assumed(0.55, "1", "Discharge of the leakage (C_dL)", 0.0, 1.5)
    motor_gain: float = assumed(22.0, "N/A", "Force and back EMF constant (B)", 1e-3, 1e5)
    motor_force: float = assumed(1.15, "N", "Force at which the motor saturates", 1e-4, 1e5)
    hysteresis_width: float = assumed(2.4e-3, "A", "Half width of a large loop", 0.0, 10.0)
    hysteresis_reach: float = assumed(0.01, "A", "Way that opens a loop fully", 1e-6, 10.0)
    inductance: float = assumed(0.03, "H", "Of the motor (L_e)", 1e-6, 100.0)
    resistance: float = assumed(20.0, "ohm", "Of the motor (R_e)", 1e-3, 1e5)
    current_gain: float = assumed(150.0, "V/A", "Current loop (k_if)", 0.0, 1e6)
    current_feedback: float = assumed(1.0, "1", "Current loop (k_ib)", 0.0, 100.0)
    current_limit: float = assumed(0.06, "A", "Largest desired current", 1e-5, 100.0)
    flow_force: float = assumed(6.0, "N s/m^2.5", "Flow force (k_Q)", 0.0, 1e4)
    flow_force_offset: float = assumed(2e-5, "m", "Of the flow force (k_1)", 1e-9, 1e-2)
    position_gain: float = assumed(8.0, "A/m", "Position loop (k_p)", 0.0, 1e5)
    velocity_gain: float = assumed(0.02, "A s/m", "Velocity loop (k_vel)", 0.0, 1e4)
    force_gain: float = assumed(1e-6, "A/N", "Force loop (k_f)", 0.0, 1.0)
    nominal_force: float = assumed(1000.0, "N", "Force that scales k_f", 1e-3, 1e7)
    linear_pressure: float = assumed(
        5e3, "Pa", "Pressure drop below which flows are linear", 1.0, 1e6, ages=False
    )


@dataclass(frozen=True, slots=True)
class ServoSystemNumbers(PhysicalNumbers):
    """Numbers of the data sheet and full scales, which plant and model share."""

    current_scale: float = assumed(0.06, "A", "Full scale of the current", 1e-5, 1e3, ages=False)
    valve_scale: float = assumed(
        250e-6, "m", "Full scale of valve position", 1e-6, 1.0, ages=False
    )
    pressure_scale: float = assumed(
        25e6, "Pa", "Full scale of supply and chambers", 1e4, 1e9, ages=False
    )
    return_scale: float = assumed(2e6, "Pa", "Full scale of return pressure", 1e4, 1e9, ages=False)
    speed_scale: float = assumed(
        0.25, "m/s", "Full scale of the load's speed", 1e-3, 1e3, ages=False
    )


PHYSICAL = tuple(f.name for f in fields(PhysicalNumbers))
"""Names of the first numbers."""

(
    PS, PR, RHO, MU, BULK, AIR, BORE, WALL, MODULUS, LENGTH_S, LENGTH_R, LENGTH_1, LENGTH_2,
    LOSSES_S, LOSSES_R, LOSSES_P, AREA_1, AREA_2, STROKE, DEAD, MP, COULOMB, STATIC, VISCOUS,
    CREEP, DECAY, KS, BS, INERTIA, ARM, BG, TORQUE, RADIUS, CLEARANCE, U_S, U_R, TRAVEL, MV, KV,
    ZETA_V, CD, CDL, B, SATURATION, WIDTH, REACH, LE, RE, KIF, KIB, LIMIT, KQ, K1, KP, KVEL, KF,
    NOMINAL, LINEAR,
) = range(len(PHYSICAL))  # fmt: skip

(
    R_S, R_R, R_1, R_2, M_S, M_R, M_P, I_S, I_R, C_LINE, C_1, C_2, V_1, V_2, V_S, V_R, MASS, BV,
    SHARE, OUTER, VALVE_STOP, PISTON_STOP, LINE, FITTINGS,
) = range(len(PHYSICAL), len(PHYSICAL) + 24)  # fmt: skip
COUNT = len(PHYSICAL) + 24
"""Length of the array, derived numbers included."""

_VALVE_STOP = 30.0  # stiffness of the valve's stops over its spring [1]
_PISTON_STOP = 2e7
"""Stiffness of the cylinder's end covers [N/m]."""


@njit(cache=True)
def derive(p: FloatArray) -> None:
    """Renew the derived numbers of `p` (COUNT,): line losses, compliances, masses."""
    area = 0.25 * pi * p[BORE] ** 2
    p[R_S] = laminar(p[MU], p[LENGTH_S], p[BORE])
    p[R_R] = laminar(p[MU], p[LENGTH_R], p[BORE])
    p[R_1] = laminar(p[MU], p[LENGTH_1], p[BORE])
    p[R_2] = laminar(p[MU], p[LENGTH_2], p[BORE])
    p[M_S] = fittings(p[LOSSES_S], p[RHO], area)
    p[M_R] = fittings(p[LOSSES_R], p[RHO], area)
    p[M_P] = fittings(p[LOSSES_P], p[RHO], area)
    p[I_S] = p[RHO] * p[LENGTH_S] / area
    p[I_R] = p[RHO] * p[LENGTH_R] / area
    wall = p[BORE] / (p[MODULUS] * p[WALL])
    p[V_S], p[V_R] = area * p[LENGTH_S], area * p[LENGTH_R]
    p[V_1], p[V_2] = area * p[LENGTH_1], area * p[LENGTH_2]
    p[C_LINE] = wall
    p[C_1], p[C_2] = p[V_1] * wall, p[V_2] * wall
    moved = p[LENGTH_1] * p[AREA_1] ** 2 + p[LENGTH_2] * p[AREA_2] ** 2
    p[MASS] = p[MP] + p[RHO] / area * moved
    p[BV] = 2.0 * p[ZETA_V] * (p[KV] * p[MV]) ** 0.5
    p[SHARE] = p[WIDTH] / mean_reach(p[REACH])
    p[OUTER] = 1.0 + p[KF] * p[NOMINAL] / p[LIMIT]
    p[VALVE_STOP] = _VALVE_STOP * p[KV]
    p[PISTON_STOP] = _PISTON_STOP
    p[LINE] = p[R_1] * p[AREA_1] ** 2 + p[R_2] * p[AREA_2] ** 2
    p[FITTINGS] = p[M_P] * (p[AREA_1] ** 3 + p[AREA_2] ** 3)
