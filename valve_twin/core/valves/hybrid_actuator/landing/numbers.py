# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Settings of the controller that sets the armature down softly."""

from __future__ import annotations

from dataclasses import dataclass

from valve_twin.core.quantity import assumed, check_quantities, compiled, quantity
from valve_twin.core.valves.hybrid_actuator.landing.kernel import Gains

SENSOR_NOISE = 3e-6
"""Position sensor of paper 001 with its data acquisition, 1.52 mV at 2.0242 mm/V [m]."""


@dataclass(frozen=True, slots=True)
class LandingNumbers:
    """Settings of the controller; all ours, tuned on the grid of +-10 % with two noise seeds.

    The last two say where its data sheet differs from the valve as it is.
    """

    period: float = assumed(
        5e-5, "s", "Sampling time: the bridge's 20 kHz", 1e-5, 2e-4, ages=False
    )
    seat_speed: float = assumed(0.05, "m/s", "Wanted speed at the seat", 1e-3, 1.0, ages=False)
    deceleration: float = assumed(25.0, "m/s^2", "Wanted at the seat", 0.0, 1e4, ages=False)
    growth: float = assumed(
        1e5, "1/s^2", "More of it a metre before the seat", 0.0, 1e8, ages=False
    )
    zone: float = assumed(
        1.4e-3, "m", "Before the seat; further out the springs' own", 1e-5, 0.1, ages=False
    )
    speed_gain: float = assumed(
        2000.0, "1/s", "Acceleration a speed that is off", 0.0, 1e5, ages=False
    )
    observer: float = assumed(4000.0, "1/s", "Triple pole of the observer", 10.0, 1e5, ages=False)
    most_current: float = assumed(45.0, "A", "Largest current asked for", 0.1, 1e3, ages=False)
    catch_from: float = assumed(
        5e-3, "m", "Distance from which the seat's coil acts", 1e-5, 0.1, ages=False
    )
    inverse_below: float = assumed(
        1.5e-3, "m", "Gap below which an inverse current is worth its heat", 0.0, 0.1, ages=False
    )
    release_until: float = assumed(
        2e-3, "m", "Way on which the other magnet is weakened", 0.0, 0.1, ages=False
    )
    reserve: float = assumed(
        0.6,
        "m^2/s^2",
        "Squared speed beyond the profile's at which the release ends",
        0.0,
        1e2,
        ages=False,
    )
    near: float = assumed(20e-6, "m", "Distance that counts as seated", 1e-7, 1e-3, ages=False)
    ramp: float = assumed(
        2e-3, "s", "In which the inverse current then goes", 1e-5, 1.0, ages=False
    )
    lasts: float = assumed(
        0.04, "s", "After which a stroke that has not landed is given up", 1e-3, 1.0, ages=False
    )
    position_noise: float = quantity(
        SENSOR_NOISE,
        "m",
        "Standard deviation of the position that it reads",
        0.0,
        1e-3,
        ages=False,
    )
    known_supply: float = assumed(
        0.0, "V", "Supply in its data sheet; 0 = the valve's", 0.0, 100.0, ages=False
    )
    known_damping: float = assumed(
        0.0, "N s/m", "Damping in its data sheet; 0 = the valve's when new", 0.0, 1e4, ages=False
    )

    def __post_init__(self) -> None:
        """Refuse numbers outside their range."""
        check_quantities(self)

    def gains(self, supply: float) -> Gains:
        """Return the numbers for the compiled functions; `supply` is the data sheet's [V]."""
        return compiled(Gains, self, supply=supply)
