# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Rise time, overshoot and settling time of a step of the setpoint; paper 000 judges by them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.simulation.plant import Drive
from valve_twin.core.valves.double_solenoid.plant_kernel import SAMPLE_S

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.double_solenoid.plant import DoubleSolenoidPlant

STEPS = (0.05, 0.10, 0.25, 0.50, 0.98)
"""Steps from the middle, over half the stroke [1]."""

BAND = 0.02
"""Share of the step that counts as settled [1]."""

BANDS = BAND * 2.0 ** np.linspace(-1.0, 1.0, 21)
"""Bands around it over which a graded settling time is the mean, half to twice, assumed [1]."""

_REST_S = 0.01
_FOLLOWED_S = 0.08


@dataclass(frozen=True, slots=True)
class StepResponse:
    """What a step did.

    Attributes
    ----------
    time_s, position : (N,) arrays
        Time since the step [s]; position over the step, 0 to 1 [1].
    rise_s : float
        From 10 to 90 % of the step [s]; NaN if it never gets there.
    overshoot : float
        Largest position beyond the step over the step [1].
    settling_s : float
        Until the position stays within 2 % of the step; infinite if it does not within 80 ms [s].
    graded_s : float
        Mean of the settling times within `BANDS`, which no ripple that just touches 2 % moves; a
        band that is not settled in counts as long as the step was followed [s].
    """

    time_s: FloatArray
    position: FloatArray
    rise_s: float
    overshoot: float
    settling_s: float
    graded_s: float


def step_response(plant: DoubleSolenoidPlant, share: float) -> StepResponse:
    """Follow a step of the setpoint from the middle for 80 ms, after 10 ms of rest.

    Parameters
    ----------
    plant : DoubleSolenoidPlant
        The valve with its controller.
    share : float
        Step over half the stroke, -1..1, not 0 [1].
    """
    rest, count = round(_REST_S / SAMPLE_S), round((_REST_S + _FOLLOWED_S) / SAMPLE_S) + 1
    setpoint = np.full(count, 0.5)
    setpoint[rest:] += 0.5 * share
    drive = Drive(setpoint, np.ones(count, dtype=np.bool_), None, np.zeros(count))
    found = plant.run(plant.initial_state(), drive, SAMPLE_S).position[rest:]
    position = (2.0 * found - 1.0) / share
    time_s: FloatArray = SAMPLE_S * np.arange(len(position), dtype=np.float64)
    return judge_step(time_s, position)


def judge_step(time_s: FloatArray, position: FloatArray) -> StepResponse:
    """Return rise, overshoot and settling of a step response.

    Parameters
    ----------
    time_s : (N,) array
        Even times since the step [s].
    position : (N,) array
        Position over the step, 0 before it, 1 where it should end [1].
    """
    period = float(time_s[1] - time_s[0])
    first, last = np.argmax(position >= 0.1), np.argmax(position >= 0.9)
    return StepResponse(
        time_s=time_s,
        position=position,
        rise_s=float(last - first) * period if (position >= 0.9).any() else float("nan"),
        overshoot=float(max(position.max() - 1.0, 0.0)),
        settling_s=_settled(position, BAND, period),
        graded_s=_graded(position, period),
    )


def _graded(position: FloatArray, period: float) -> float:
    """Return the mean of the settling times in all `BANDS` [s].

    A band that is not settled in counts as long as the step was followed: a design that ends at
    1.01 % is hardly worse than one that ends at 0.99 %.
    """
    followed = period * (len(position) - 1)
    return float(np.mean([min(_settled(position, float(b), period), followed) for b in BANDS]))


def _settled(position: FloatArray, band: float, period: float) -> float:
    outside = np.flatnonzero(~(np.abs(position - 1.0) <= band))
    if len(outside) and outside[-1] + 1 == len(position):
        return float("inf")
    return period * (int(outside[-1]) + 1) if len(outside) else 0.0
