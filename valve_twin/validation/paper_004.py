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
from valve_twin.core.valves.stepper_servo.plant import StepperServoPlant
from valve_twin.validation.bench_004 import follow, scan, track_square, velocity_sweep
from valve_twin.validation.check import Check, Kind, cannot, within_range
from valve_twin.validation.registry import Paper

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.types import FloatArray

PERIOD_S = 0.01
MM = 1e-3
G_NUMERATOR = (-0.1675, -0.1039)
G_DENOMINATOR = (1.0, -0.8512, -0.1351, -0.03855)
"""Paper 004, eq. (11)."""

WORKING_MM = (0.15, 1.95)
"""Overall working range, section 2.2."""

SPEED_MM_S = 10.0

AMPLITUDE_MM = 0.5
"""Amplitude of our sines, which the drive can follow up to 3 Hz; the paper's is not stated."""

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
    """Compare section 2 with what a slow scan of the simulated valve shows."""
    found = scan(plant)
    lower, upper = found.closed
    share = 70 * plant.step_size / MM / (0.5 * (WORKING_MM[1] - WORKING_MM[0]))
    step = plant.step_size / MM
    known = "taken from the paper, read back from a scan at a step in 2 s; limits: one step"
    rows = (
        ("Section 2.1", "backlash between up and down [mm]", 0.1, found.backlash, step),
        ("Section 2.2", "dead band begins [mm]", 0.45, lower, step),
        ("Section 2.2", "dead band ends [mm]", 1.70, upper, step),
        ("Section 2.2", "position that regulates the flow, upper [mm]", 0.2, found.regulated[1],
         2.0 * step),
    )  # fmt: skip
    return [
        *(_within(*row, known, Kind.REGRESSION) for row in rows),
        cannot("Section 2.2", "position that regulates the flow, lower [mm]", 0.2,
               found.regulated[0], "0.45 less 0.2 mm, both as printed, leave 0.25 mm"),
        cannot("Section 2.1", "70 steps over half the working range [1]",
               "almost the whole working range", share, "70 steps of 0.01 mm of 0.9 mm"),
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
        cannot("Fig. 8", "magnitude of G(z) at 1 Hz less that at 10 Hz [dB]", "a figure",
               float(-np.diff(bode(np.array([1.0, 10.0])))[0]),
               "its axes are not in the text; drawn from eq. (11) as printed"),
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
        _within("Section 4", "K_p [1]", 0.35, found.gain, 5e-3, "rounded", Kind.DERIVED),
        _within("Section 4", "T_i [s]", 0.02, found.integral_time_s, 5e-3, note, Kind.DERIVED),
        _within("Section 4", "T_d [s]", 0.004, found.derivative_time_s, 5e-4, note, Kind.DERIVED),
    ]


def drive(plant: StepperServoPlant) -> list[Check]:
    """Compare the law of the steps, the velocity sweep and the tracking of steps."""
    printed = SLOWEST - FASTER * FULL_SPEED
    time_s, spool, speed = velocity_sweep(plant)
    half = len(time_s) // 2
    steps = np.abs(speed[1:half][np.diff(speed[:half]) != 0.0])
    full = time_s[half] - 0.02  # the last 20 ms before the turn
    at = np.flatnonzero((time_s >= full) & (time_s < time_s[half]))
    end = float(np.polyfit(time_s[at], spool[at], 1)[0])
    return [
        cannot("Eq. (14)", "delay at u = 0.03 [samples]", printed, step_delay(FULL_SPEED),
               "as printed it reaches 0, and is negative for u < -0.03: corrected with |u| and "
               "at least one sample"),
        within_range("Fig. 10", "least change of speed as the delay shrinks [mm/s]",
                     "speed increases", float(np.diff(steps).min()), lower=0.0,
                     note=f"{len(steps)} different speeds, {steps.min():.2g} to "
                     f"{steps.max():.2g} mm/s"),
        _within("Fig. 10", "spool speed at the end of the sweep [mm/s]", 10.0, end, 0.2,
                "1000 steps/s of 18 degrees, section 2.1", Kind.DERIVED),
        *_square(plant, 1.0),
        *_square(plant, 3.0),
    ]  # fmt: skip


def _square(plant: StepperServoPlant, frequency: float) -> list[Check]:
    """Compare fig. 11: steps over the maximum working range, without overshoot."""
    low, high = WORKING_MM
    _, spool = track_square(plant, frequency, WORKING_MM)
    settled = spool[len(spool) // 2 :]
    beyond = max(float(settled.max()) - high, low - float(settled.min()), 0.0)
    reached = float(np.ptp(settled)) / (high - low)
    where, at = "Fig. 11", f"{frequency:g} Hz"
    checks = [
        within_range(where, f"overshoot of steps at {at} [1]", "without overshoot",
                     beyond / (high - low), upper=plant.step_size / MM / (high - low),
                     note="over 1.8 mm; limit: one step of the motor")
    ]  # fmt: skip
    if half_period(frequency) < (high - low) / SPEED_MM_S:
        why = f"1.8 mm at 10 mm/s take 0.18 s, half a period {half_period(frequency):.3f} s"
        return [*checks, cannot(where, f"range reached at {at} [1]", "tracks", reached, why)]
    return [*checks, within_range(where, f"range reached at {at} [1]", "tracks", reached,
                                  lower=0.99, upper=1.01)]  # fmt: skip


def half_period(frequency_hz: float) -> float:
    """Return half a period [s]."""
    return 0.5 / frequency_hz


def bode(frequency_hz: FloatArray) -> FloatArray:
    """Return the magnitude of the printed G(z), eq. (11), at frequencies (N,) [Hz], in dB."""
    z = np.exp(2j * np.pi * frequency_hz * PERIOD_S)
    gain = np.polyval(G_NUMERATOR, z) / np.polyval(G_DENOMINATOR, z)
    decibel: FloatArray = 20.0 * np.log10(np.abs(gain))
    return decibel


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
    tick, every = plant.controller.period_s, plant.ticks_per_sample(PERIOD_S)
    samples = round(_LENGTH_S / PERIOD_S)
    unit = plant.stroke / MM
    angle: FloatArray = 2.0 * np.pi * frequency_hz * tick * np.arange(float(samples * every))
    reference = 0.5 + amplitude_mm / unit * np.sin(angle)
    position = follow(plant, unit * reference, tick).spool[::every] / unit
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
    item: str,
    quantity: str,
    published: float,
    obtained: float,
    half: float,
    note: str = "",
    kind: Kind = Kind.PUBLISHED,
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
        kind,
    )


PAPER = Paper("004", "the stepper-driven servo-valve", len(_TABLE_1), recompute)
