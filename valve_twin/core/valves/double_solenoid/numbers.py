# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The numbers of the double-solenoid valve's data sheet."""

from __future__ import annotations

from dataclasses import dataclass

from valve_twin.core.quantity import quantity


@dataclass(frozen=True, slots=True)
class DoubleSolenoidNumbers:
    """Numbers of the data sheet, which plant and model share."""

    mass: float = quantity(0.075, "kg", "Armature and spool", lower=1e-3, upper=10.0, assumed=True)
    spring_1: float = quantity(
        5e3, "N/m", "Rate of the spring that pushes towards A", lower=1.0, upper=1e6, assumed=True
    )
    spring_2: float = quantity(
        5e3, "N/m", "Rate of the spring that pushes towards B", lower=1.0, upper=1e6, assumed=True
    )
    preload_1: float = quantity(
        20.0, "N", "Spring 1 with the spool in the middle", lower=0.0, upper=1e3, assumed=True
    )
    preload_2: float = quantity(
        20.0, "N", "Spring 2 with the spool in the middle", lower=0.0, upper=1e3, assumed=True
    )
    friction: float = quantity(
        6.0,
        "N",
        "Coulomb friction peak to peak (F_h): half of it on each side",
        lower=0.0,
        upper=500.0,
        assumed=True,
    )
    alpha: float = quantity(
        800.0, "s/m", "Steepness of the smoothed friction", lower=1.0, upper=5e3, assumed=True
    )
    beta: float = quantity(18.0, "N s/m", "Viscous damping", lower=0.0, upper=1e4, assumed=True)
    force_gain: float = quantity(
        1.0, "1", "Force over that of the characteristic curves", lower=0.05, upper=5.0
    )
    resistance_a: float = quantity(2.6, "ohm", "Coil A", lower=0.01, upper=1e3, assumed=True)
    resistance_b: float = quantity(2.6, "ohm", "Coil B", lower=0.01, upper=1e3, assumed=True)
    half_stroke: float = quantity(
        0.8e-3, "m", "From the middle to a fully open port", lower=1e-4, upper=0.02, assumed=True
    )
    end_stop: float = quantity(
        0.9e-3, "m", "From the middle to an end stop", lower=1e-4, upper=0.03, assumed=True
    )
    turns: float = quantity(350.0, "1", "Turns of a coil", lower=1.0, upper=1e5, assumed=True)
    pole_area: float = quantity(
        1.2e-4, "m^2", "Area of a pole", lower=1e-6, upper=0.1, assumed=True
    )
    gap: float = quantity(
        1.7e-3,
        "m",
        "Gap in the middle: 1.4 mm and a residual 0.3 mm",
        lower=1e-4,
        upper=0.05,
        assumed=True,
    )
    saturation_flux: float = quantity(
        0.040,
        "Wb",
        "Flux linkage at which the iron takes 1 A",
        lower=1e-4,
        upper=10.0,
        assumed=True,
    )
    coupling: float = quantity(
        0.06,
        "1",
        "Mutual inductance over a coil's own in the middle",
        lower=0.0,
        upper=0.4,
        assumed=True,
    )
    current_b1: float = quantity(
        0.55e-3, "s", "b1 of G_A and G_B", lower=0.0, upper=0.1, assumed=True, ages=False
    )
    current_b2: float = quantity(
        0.045e-6, "s^2", "b2 of G_A and G_B", lower=0.0, upper=1e-2, assumed=True, ages=False
    )
    current_a1: float = quantity(
        0.43e-3, "s", "a1 of G_A and G_B", lower=2e-5, upper=0.1, assumed=True, ages=False
    )
    current_a2: float = quantity(
        0.028e-6, "s^2", "a2 of G_A and G_B", lower=1e-9, upper=1e-2, assumed=True, ages=False
    )
    force_f1: float = quantity(
        0.25e-3, "s", "f1 of G_F", lower=0.0, upper=0.1, assumed=True, ages=False
    )
    force_f2: float = quantity(
        0.010e-6, "s^2", "f2 of G_F", lower=0.0, upper=1e-2, assumed=True, ages=False
    )
    force_d1: float = quantity(
        0.75e-3, "s", "d1 of G_F", lower=2e-5, upper=0.1, assumed=True, ages=False
    )
    force_d2: float = quantity(
        0.090e-6, "s^2", "d2 of G_F", lower=1e-9, upper=1e-2, assumed=True, ages=False
    )
    supply_voltage: float = quantity(
        24.0, "V", "Levels of the bridges, + and -", lower=1.0, upper=100.0, ages=False
    )
    current_scale: float = quantity(
        5.0, "A", "Full scale of the current sensors", lower=0.1, upper=100.0, assumed=True,
        ages=False,
    )  # fmt: skip
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
        6.52e-4, "H", "Mutual inductance with a computed field", lower=0.0, upper=1.0, ages=False
    )
