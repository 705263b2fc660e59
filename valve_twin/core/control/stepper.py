# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The position controller of the stepper valve: PID, and the law that makes steps of its output.

Paper 004, eq. (14), prints tau_d = 15 - 500 |u| for u <= 0.03 and 1 above: it reaches 0 at the
limit, is negative for u < -0.03 and never stops. Corrected here: the test takes |u|, the delay is
at least one sample, and an error inside a dead zone makes no step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.quantity import assumed, check_quantities, compiled, quantity
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

STATE_SIZE = 3
"""Integral of the error [V s], last error [V], samples since the last step."""

SLOWEST = 15.0
"""Delay between steps at no output [samples]; paper 004, eq. (14)."""
FASTER = 500.0
"""How much an output of 1 shortens it [samples]; paper 004, eq. (14)."""
FULL_SPEED = 0.03
"""Output from which on every sample makes a step; paper 004, eq. (14)."""

_INTEGRAL, _LAST_ERROR, _WAITED = 0, 1, 2


@dataclass(frozen=True, slots=True)
class StepperGains:
    """Gains of a PID in standard form: K_p (1 + 1/(T_i s) + T_d s)."""

    gain: float
    integral_time_s: float
    derivative_time_s: float


def ziegler_nichols(critical_gain: float, critical_period_s: float) -> StepperGains:
    """Return the classical PID gains: 0.6 K, T/2, T/8.

    Paper 004 gives K = 0.58 and T = 0.032 s; its K_i = 0.02 and K_d = 0.004 are the times.
    """
    return StepperGains(0.6 * critical_gain, 0.5 * critical_period_s, 0.125 * critical_period_s)


class StepperSettings(NamedTuple):
    """Numbers of `StepperConfig` as the compiled controller takes them, same names and units."""

    period_s: float
    gain: float
    integral_time: float
    derivative_time: float
    dead_zone: float


@dataclass(frozen=True, slots=True)
class StepperConfig:
    """Numbers of the position controller; every field carries its unit, range and description."""

    period_s: float = assumed(0.001, "s", "Base sample of the controller", 1e-4, 0.1)
    gain: float = quantity(0.35, "1", "Output per error of 1 V (paper 004)", 0.0, 1e3)
    integral_time: float = quantity(0.02, "s", "Integral time T_i (paper 004)", 1e-4, 1e6)
    derivative_time: float = quantity(0.004, "s", "Derivative time T_d (paper 004)", 0.0, 10.0)
    volts_per_metre: float = assumed(1000.0, "V/m", "Scale of the position sensor", 1.0, 1e6)
    dead_zone: float = assumed(
        6e-6, "m", "Error that makes no step: half a step or more", 0.0, 1e-3
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check_quantities(self)

    def settings(self) -> StepperSettings:
        """Return the numbers for `stepper_step`."""
        dead_zone = self.dead_zone * self.volts_per_metre
        return compiled(StepperSettings, self, dead_zone=dead_zone)


@njit(cache=True)
def step_delay(output: float) -> int:
    """Return how many samples pass between two steps at a controller output."""
    size = abs(output)
    if size > FULL_SPEED:
        return 1
    return max(1, int(np.round(SLOWEST - FASTER * size)))


@njit(cache=True)
def stepper_step(state: FloatArray, c: StepperSettings, error: float) -> int:
    """Run one base sample of the controller.

    The integral stands still while the drive runs at full speed, and starts anew in the dead zone.

    Parameters
    ----------
    state : (3,) array
        See `STATE_SIZE`; written in place.
    c : StepperSettings
        Numbers of the controller.
    error : float
        Reference minus measured position [V].

    Returns
    -------
    int
        +1, -1 or 0 full steps.
    """
    change = error - state[_LAST_ERROR]
    state[_LAST_ERROR] = error
    state[_WAITED] += 1.0
    if abs(error) <= c.dead_zone:
        state[_INTEGRAL] = 0.0
        return 0
    integral = state[_INTEGRAL] + error * c.period_s
    output = c.gain * (
        error + integral / c.integral_time + c.derivative_time * change / c.period_s
    )
    if abs(output) <= FULL_SPEED:
        state[_INTEGRAL] = integral
    if output == 0.0 or state[_WAITED] < step_delay(output):
        return 0
    state[_WAITED] = 0.0
    return 1 if output > 0.0 else -1
