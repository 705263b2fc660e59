# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Position control by a PID whose gains follow the error (paper 000, section 1).

Proportional and integral gains are curves of the error: large ones near the target, where friction
holds the spool, small ones far away, where the drive saturates. Towards the ends of the stroke the
force of a coil grows and pulls the spool on: gain and damping fall there with the square of the
position, and a cubic output holds against the pull. Without it the loop swings at the ends.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from valve_twin.core.quantity import assumed, check_quantities, compiled
from valve_twin.kernels import njit


class PidGains(NamedTuple):
    """Numbers of `PidConfig` as the compiled controller takes them."""

    near: float
    far: float
    integral_near: float
    integral_far: float
    rate: float
    knee: float
    gain_fall: float
    rate_fall: float
    hold: float


@dataclass(frozen=True, slots=True)
class PidConfig:
    """Numbers of the nonlinear PID; errors are shares of half the stroke."""

    gain_near: float = assumed(11.6, "1", "Proportional gain at no error", 0.0, 1e3, ages=False)
    gain_far: float = assumed(1.28, "1", "Proportional gain far away", 0.0, 1e3, ages=False)
    integral_near: float = assumed(740.0, "1/s", "Integral gain at no error", 0.0, 1e6, ages=False)
    integral_far: float = assumed(0.0, "1/s", "Integral gain far away", 0.0, 1e6, ages=False)
    rate: float = assumed(2.9e-3, "s", "Gain on the speed", 0.0, 1.0, ages=False)
    knee: float = assumed(0.026, "1", "Error at which gains are half way", 1e-4, 2.0, ages=False)

    gain_fall: float = assumed(
        1.27, "1", "Proportional gain at an end: over 1 + this", 0.0, 100.0, ages=False
    )
    rate_fall: float = assumed(
        0.59, "1", "Gain on the speed at an end: over 1 + this", 0.0, 100.0, ages=False
    )
    hold: float = assumed(
        -0.12, "1", "Output at an end against the pull of the coil", -1.0, 1.0, ages=False
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check_quantities(self)

    def gains(self) -> PidGains:
        """Return the numbers for the compiled controller."""
        return compiled(PidGains, self, near=self.gain_near, far=self.gain_far)


@njit(cache=True)
def pid_output(
    g: PidGains, error: float, speed: float, integral: float, period: float, place: float
) -> tuple[float, float]:
    """Return the output, limited to -1..1, and the integral part after this sample [1].

    Parameters
    ----------
    g : PidGains
        Its numbers.
    error : float
        Wanted minus present position, over half the stroke [1].
    speed : float
        Of the position, over half the stroke [1/s].
    integral : float
        Integral part before [1].
    period : float
        Control sample [s].
    place : float
        Present position, over half the stroke [1].
    """
    share = abs(error) / (abs(error) + g.knee)
    gain = g.near + share * (g.far - g.near)
    slope = g.integral_near + share * (g.integral_far - g.integral_near)
    after = min(max(integral + slope * error * period, -1.0), 1.0)
    square = place * place
    gain /= 1.0 + g.gain_fall * square
    known = g.hold * place * square - g.rate / (1.0 + g.rate_fall * square) * speed
    wanted = gain * error + after + known
    if abs(wanted) > 1.0 and wanted * error > 0.0:
        after = integral
        wanted = gain * error + after + known
    return min(max(wanted, -1.0), 1.0), after
