# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The physical numbers of the servosystem in the order of the compiled functions.

The compiled functions take one array: the estimation changes its entries, `derive` then renews
what follows from them.
"""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING

from numba import njit

from valve_twin.core.physics.fluid import fittings, laminar
from valve_twin.core.physics.hysteresis import mean_reach

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

PHYSICAL = (
    "supply_pressure",
    "return_pressure",
    "density",
    "viscosity",
    "bulk_modulus",
    "air_share",
    "line_bore",
    "line_wall",
    "line_modulus",
    "supply_length",
    "return_length",
    "length_1",
    "length_2",
    "supply_losses",
    "return_losses",
    "piston_losses",
    "area_1",
    "area_2",
    "stroke",
    "dead_length",
    "piston_mass",
    "coulomb_friction",
    "static_friction",
    "viscous_friction",
    "creep_speed",
    "decay_speed",
    "structural_stiffness",
    "structural_damping",
    "load_inertia",
    "arm",
    "load_damping",
    "load_torque",
    "port_radius",
    "clearance",
    "supply_underlap",
    "return_underlap",
    "valve_travel",
    "valve_mass",
    "valve_stiffness",
    "valve_damping_ratio",
    "discharge",
    "leak_discharge",
    "motor_gain",
    "motor_force",
    "hysteresis_width",
    "hysteresis_reach",
    "inductance",
    "resistance",
    "current_gain",
    "current_feedback",
    "current_limit",
    "flow_force",
    "flow_force_offset",
    "position_gain",
    "velocity_gain",
    "force_gain",
    "nominal_force",
    "linear_pressure",
)
"""Names of the first numbers, those of `ServoSystemPlant`; units stand there."""

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
