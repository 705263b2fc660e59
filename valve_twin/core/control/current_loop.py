# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Current control of a coil: a PI controller at 10 kHz and a bridge that switches once a sample.

In every control sample the voltage can be inverted once, at one of 8 sub-steps (paper 000, section
2.2): two levels to start from and 8 instants, the last = no inversion, make 16 patterns with 9
mean voltages. The bridge goes on from the level it has, where the wanted mean allows it.
"""

from __future__ import annotations

from typing import NamedTuple

from valve_twin.kernels import njit

SUB_STEPS = 8
"""Sub-steps of a control sample; paper 000, section 2.2."""

PATTERNS = 2 * SUB_STEPS
"""Switching patterns of a control sample."""

STEP_S = 1.25e-5
"""A sub-step: an eighth of a control sample [s]; paper 000, section 2.2."""

SAMPLE_S = SUB_STEPS * STEP_S
"""A control sample [s]."""


class CurrentGains(NamedTuple):
    """Numbers of the current controller: V/A, V/(A s) a sample, V, ohm."""

    proportional: float
    integral: float
    supply: float
    resistance: float


class CurrentSensor(NamedTuple):
    """Full scale and resolution [A]."""

    scale: float
    quantum: float


@njit(cache=True, inline="always")
def rounded(value: float, quantum: float) -> float:
    """Return a value in whole steps of `quantum`, in its unit; 0 = as it is."""
    return round(value / quantum) * quantum if quantum > 0.0 else value


@njit(cache=True, inline="always")
def shown_current(sensor: CurrentSensor, current: float) -> float:
    """Return what a sensor shows of a current [A], in parts of its full scale [1]."""
    return rounded(current, sensor.quantum) / sensor.scale


@njit(cache=True)
def current_control(g: CurrentGains, wanted: float, current: float, integral: float) -> float:
    """Return the voltage of a PI controller with feed-forward, not yet limited [V].

    Parameters
    ----------
    g : CurrentGains
        Its numbers.
    wanted, current : float
        Reference and measurement [A].
    integral : float
        Integral part [V].
    """
    return g.resistance * wanted + g.proportional * (wanted - current) + integral


@njit(cache=True)
def integrate_error(
    g: CurrentGains, wanted: float, current: float, integral: float, voltage: float
) -> float:
    """Return the integral part after a sample; it stands while the voltage is limited [V].

    Parameters
    ----------
    g : CurrentGains
        Gains and supply.
    wanted, current : float
        Reference and measurement [A].
    integral : float
        Integral part before the sample [V].
    voltage : float
        Voltage that the controller asks for [V].
    """
    if abs(voltage) >= g.supply and voltage * (wanted - current) > 0.0:
        return integral
    limit = 0.5 * g.supply
    return min(max(integral + g.integral * (wanted - current), -limit), limit)


@njit(cache=True)
def positive_steps(voltage: float, supply: float) -> int:
    """Return how many of the 8 sub-steps are positive for a wanted mean voltage [V]."""
    half = 0.5 * SUB_STEPS
    return int(min(max(round(half * voltage / supply + half), 0.0), float(SUB_STEPS)))


@njit(cache=True)
def mean_voltage(positive: int, supply: float) -> float:
    """Return the mean voltage of a pattern [V]."""
    return supply * (2.0 * positive / SUB_STEPS - 1.0)


@njit(cache=True)
def level_at(start: float, positive: int, sub_step: int) -> float:
    """Return the sign of the voltage in a sub-step.

    Parameters
    ----------
    start : float
        Level of the last sub-step before, +1 or -1 [1].
    positive : int
        Positive sub-steps of the sample, 0..8.
    sub_step : int
        Which, 0..7.
    """
    if start > 0.0:
        return 1.0 if sub_step < positive else -1.0
    return 1.0 if sub_step >= SUB_STEPS - positive else -1.0


@njit(cache=True)
def pattern(index: int) -> tuple[float, int]:
    """Return start level [1] of one of 16 patterns and its sub-steps before the inversion."""
    start = 1.0 if index < SUB_STEPS else -1.0
    return start, index % SUB_STEPS + 1
