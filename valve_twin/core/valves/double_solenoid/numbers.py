# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The numbers of the double-solenoid valve's data sheet."""

from __future__ import annotations

from dataclasses import dataclass, field

from valve_twin.core.quantity import assumed, quantity, setting
from valve_twin.core.valves.double_solenoid.eddies import EddyConfig


@dataclass(frozen=True, slots=True)
class DoubleSolenoidNumbers:
    """Numbers of the data sheet, which plant and model share."""

    mass: float = assumed(0.075, "kg", "Armature and spool", 1e-3, 10.0)
    spring_1: float = assumed(5e3, "N/m", "Rate of the spring that pushes towards A", 1.0, 1e6)
    spring_2: float = assumed(5e3, "N/m", "Rate of the spring that pushes towards B", 1.0, 1e6)
    preload_1: float = assumed(20.0, "N", "Spring 1 with the spool in the middle", 0.0, 1e3)
    preload_2: float = assumed(20.0, "N", "Spring 2 with the spool in the middle", 0.0, 1e3)
    friction: float = assumed(
        6.0, "N", "Coulomb friction peak to peak (F_h): half of it on each side", 0.0, 500.0
    )
    alpha: float = assumed(800.0, "s/m", "Steepness of the smoothed friction", 1.0, 5e3)
    beta: float = assumed(18.0, "N s/m", "Viscous damping", 0.0, 1e4)
    force_gain: float = quantity(
        1.0, "1", "Force over that of the characteristic curves", 0.05, 5.0
    )
    resistance_a: float = assumed(2.6, "ohm", "Coil A", 0.01, 1e3)
    resistance_b: float = assumed(2.6, "ohm", "Coil B", 0.01, 1e3)
    half_stroke: float = assumed(0.8e-3, "m", "From the middle to a fully open port", 1e-4, 0.02)
    end_stop: float = assumed(0.9e-3, "m", "From the middle to an end stop", 1e-4, 0.03)
    turns: float = assumed(350.0, "1", "Turns of a coil", 1.0, 1e5)
    pole_area: float = assumed(1.2e-4, "m^2", "Area of a pole", 1e-6, 0.1)
    gap: float = assumed(
        1.7e-3, "m", "Gap in the middle: 1.4 mm and a residual 0.3 mm", 1e-4, 0.05
    )
    saturation_flux: float = assumed(
        0.040, "Wb", "Flux linkage at which the iron takes 1 A", 1e-4, 10.0
    )
    coupling: float = assumed(
        0.06, "1", "Mutual inductance over a coil's own in the middle", 0.0, 0.4
    )
    current_b1: float = assumed(0.55e-3, "s", "b1 of G_A and G_B", 0.0, 0.1, ages=False)
    current_b2: float = assumed(0.045e-6, "s^2", "b2 of G_A and G_B", 0.0, 1e-2, ages=False)
    current_a1: float = assumed(0.43e-3, "s", "a1 of G_A and G_B", 2e-5, 0.1, ages=False)
    current_a2: float = assumed(0.028e-6, "s^2", "a2 of G_A and G_B", 1e-9, 1e-2, ages=False)
    force_f1: float = assumed(0.25e-3, "s", "f1 of G_F", 0.0, 0.1, ages=False)
    force_f2: float = assumed(0.010e-6, "s^2", "f2 of G_F", 0.0, 1e-2, ages=False)
    force_d1: float = assumed(0.75e-3, "s", "d1 of G_F", 2e-5, 0.1, ages=False)
    force_d2: float = assumed(0.090e-6, "s^2", "d2 of G_F", 1e-9, 1e-2, ages=False)
    eddies: EddyConfig = field(default_factory=EddyConfig)
    supply_voltage: float = quantity(
        24.0, "V", "Levels of the bridges, + and -", 1.0, 100.0, ages=False
    )
    current_scale: float = assumed(
        5.0, "A", "Full scale of the current sensors", 0.1, 100.0, ages=False
    )
    map_current: tuple[float, ...] = quantity(
        (),
        "A",
        "Currents of a computed field, from 0; empty or one alone = pole, gap, saturation above",
    )
    map_position: tuple[float, ...] = quantity((), "m", "Positions of a computed field, -x .. x")
    map_flux: tuple[float, ...] = quantity(
        (), "Wb", "Flux linkages, the positions of a current together"
    )
    map_mutual: float = quantity(
        6.52e-4, "H", "Mutual inductance with a computed field; below 0 where the fluxes of both "
        "coils meet", -1.0, 1.0, ages=False
    )  # fmt: skip
    map_coenergy: tuple[float, ...] = quantity(
        (),
        "J",
        "Coenergy of both coils in place of map_flux: coefficients of the spline that "
        "valve-twin design export writes",
    )
    map_source: str = setting("", "What map_coenergy was computed from; for the reader only")
