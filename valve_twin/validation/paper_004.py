# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Paper 004, the stepper-driven servo-valve: every published number, recomputed.

The measured data are not public: the identified model and its fit cannot be checked, the geometry,
the gains and the drive can. Tracking is recomputed on the simulated valve.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.control.stepper import (
    FASTER,
    FULL_SPEED,
    SLOWEST,
    step_delay,
    ziegler_nichols,
)
from valve_twin.core.simulation.plant import Drive
from valve_twin.core.valves.stepper_servo.plant import StepperServoPlant
from valve_twin.validation.check import Check, cannot, within_range, within_share
from valve_twin.validation.registry import Paper

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.types import FloatArray

PERIOD_S = 0.01
MM = 1e-3
G_DENOMINATOR = (1.0, -0.8512, -0.1351, -0.03855)
"""Paper 004, eq. (11)."""

AMPLITUDE_MM = 0.5
"""Amplitude of our sines, which the drive can follow up to 3 Hz; the paper's is not stated."""

_CENTRE_MM = 1.075
_SETTLED_S = 2.0
_LENGTH_S = 6.0
_TABLE_1 = ((0.5, 0.028, 0.81), (1.0, 0.032, 1.8), (3.0, 0.11, 3.24))
"""Frequency [Hz], largest error [V], phase shift [degrees]."""


def recompute(advance: Callable[[], None]) -> tuple[Check, ...]:
    """Recompute every published number; `advance` is called once a sine."""
    plant = StepperServoPlant()
    checks = [*geometry(plant), *identified_model(), *gains(), *drive(plant)]
    for frequency, error, phase in _TABLE_1:
        checks += _table_1(plant, frequency, error, phase)
        advance()
    return tuple(checks)


def geometry(plant: StepperServoPlant) -> list[Check]:
    """Compare the numbers of section 2 with those of the simulated valve."""
    reach = 70 * plant.step_size / MM
    upper = _CENTRE_MM + reach - plant.band_upper / MM
    lower = plant.band_lower / MM - (_CENTRE_MM - reach)
    note = "steps and backlash in full steps, not in turns"
    return [
        within_share("Section 2.1", "backlash of 10 steps [mm]", 0.1, 10 * plant.step_size / MM,
                     1e-9, note),
        within_share("Section 2.1", "speed at 1000 steps/s [mm/s]", 10.0,
                     1000 * plant.step_size / MM, 1e-9, "18 degrees a step, lead 0.2 mm"),
        within_range("Section 2.1", "70 steps up, beyond the dead band [mm]",
                     "almost the whole working range", upper, lower=0.05, upper=0.10,
                     note="it reaches 0.075 mm of the 0.2 mm that regulate the flow"),
        within_range("Section 2.1", "70 steps down, beyond the dead band [mm]",
                     "almost the whole working range", lower, lower=0.05, upper=0.10),
        within_share("Section 2.2", "dead band [mm]", 1.25,
                     (plant.band_upper - plant.band_lower) / MM, 1e-9, "0.45 to 1.70 mm"),
    ]  # fmt: skip


def identified_model() -> list[Check]:
    """Compare section 3: its data are not public."""
    pole = float(np.abs(np.roots(G_DENOMINATOR)).max())
    return [
        cannot("Section 3", "average fit [%]", 87.49, float("nan"),
               "no data; which of three fits it is and the orders are not stated"),
        cannot("Eq. (11)", "largest pole of G(z) [1]", "a model of the valve", pole,
               "outside the unit circle: its free run diverges, rounding cannot explain it and "
               "no single repair stands out"),
        cannot("Eq. (12)", "input non-linearity", "0.598 u^2 - 0.00048 u^3", float("nan"),
               "in ampere the cubic term vanishes, in milliampere it is absurd"),
        cannot("Section 3", "filter 0 to 60 Hz at 10 ms", 60.0, 0.5 / PERIOD_S,
               "the highest frequency that 10 ms can carry is 50 Hz"),
    ]  # fmt: skip


def gains() -> list[Check]:
    """Compare the controller's gains with Ziegler-Nichols at K = 0.58, T = 0.032 s."""
    found = ziegler_nichols(0.58, 0.032)
    note = "printed as K_i and K_d, which would be 21.8 and 0.0014: they are times"
    return [
        _within("Section 4", "K_p [1]", 0.35, found.gain, 5e-3),
        _within("Section 4", "T_i [s]", 0.02, found.integral_time_s, 5e-3, note),
        _within("Section 4", "T_d [s]", 0.004, found.derivative_time_s, 5e-3, note),
    ]


def drive(plant: StepperServoPlant) -> list[Check]:
    """Compare the law of the steps and the range it can move."""
    step_mm = plant.step_size / MM
    range_s = 1.8 / (step_mm / plant.controller.period_s)
    printed = SLOWEST - FASTER * FULL_SPEED
    return [
        within_range("Eq. (14)", "delay at u = 0 [samples]", 15.0, step_delay(0.0),
                     lower=15.0, upper=15.0),
        within_range("Eq. (14)", "delay above u = 0.03 [samples]", 1.0, step_delay(0.031),
                     lower=1.0, upper=1.0),
        cannot("Eq. (14)", "delay at u = 0.03 [samples]", printed, step_delay(FULL_SPEED),
               "as printed it reaches 0, and is negative for u < -0.03: corrected with |u| and "
               "at least one sample"),
        cannot("Fig. 11", "half a period at 3 Hz over the maximum range [s]", 1.0 / 6.0, range_s,
               "1.8 mm at 10 mm/s take longer: 3 Hz holds up to 1.67 mm"),
    ]  # fmt: skip


def _table_1(
    plant: StepperServoPlant, frequency: float, error: float, phase: float
) -> list[Check]:
    ours = track_sine(plant, frequency, AMPLITUDE_MM)
    why = "amplitude and sensor scale are not stated; ours: 0.5 mm, 1 V/mm"
    at = f"{frequency:g} Hz"
    return [
        cannot("Table 1", f"largest error at {at} [V]", error, ours[0], why),
        cannot("Table 1", f"phase shift at {at} [degrees]", phase, ours[1], why),
    ]


def track_sine(
    plant: StepperServoPlant, frequency_hz: float, amplitude_mm: float
) -> tuple[float, float, float]:
    """Return largest error [mm], phase shift [degrees] and gain [1] of a tracked sine.

    Parameters
    ----------
    plant : StepperServoPlant
        The valve with its controller.
    frequency_hz, amplitude_mm : float
        Of the reference [Hz] [mm], about the centre of the stroke.
    """
    tick = plant.controller.period_s
    samples = round(_LENGTH_S / PERIOD_S)
    every = plant.ticks_per_sample(PERIOD_S)
    unit = plant.stroke / MM
    ticks = np.arange(samples * every, dtype=np.float64)
    angle: FloatArray = 2.0 * np.pi * frequency_hz * tick * ticks
    reference = 0.5 + amplitude_mm / unit * np.sin(angle)
    drive_ = Drive(reference, np.zeros(samples * every, dtype=np.bool_), None, np.zeros(samples))
    position = plant.run(plant.initial_state(), drive_, PERIOD_S).position
    settled = slice(round(_SETTLED_S / PERIOD_S), None)
    wanted, angle = reference[::every][settled], angle[::every][settled]
    in_phase, across = _harmonic(position[settled], angle)
    error = float(np.abs(position[settled] - wanted).max()) * unit
    gain = float(np.hypot(in_phase, across)) * unit / amplitude_mm
    return error, -float(np.degrees(np.arctan2(across, in_phase))), gain


def _harmonic(position: FloatArray, angle: FloatArray) -> tuple[float, float]:
    basis = np.column_stack([np.sin(angle), np.cos(angle), np.ones(len(angle))])
    found = np.linalg.lstsq(basis, position, rcond=None)[0]
    return float(found[0]), float(found[1])


def _within(
    item: str, quantity: str, published: float, obtained: float, half: float, note: str = ""
) -> Check:
    return Check(
        item,
        quantity,
        published,
        obtained,
        published - half,
        published + half,
        f"{half:g}",
        note,
    )


PAPER = Paper("004", "the stepper-driven servo-valve", len(_TABLE_1), recompute)
