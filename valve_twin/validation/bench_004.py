# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The experiments of paper 004 on the simulated valve: slow scan, velocity sweep, tracking."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.simulation.plant import Drive

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.stepper_servo.plant import StepperServoPlant

MM = 1e-3
SETTLED_S = 2.0
"""Start of what is compared in a tracked reference [s]."""

_SCAN_S = 0.01
_SLOW_S = 2.0  # a step, section 2.2 [s]
_SLOWEST_DELAY, _DELAY_STEP, _EVERY_TICKS = 100, 5, 5  # of the velocity sweep, section 4
_FULL_TICKS = 40  # at full speed after the sweep, assumed
_CLOSED = 1e-3  # flow that counts as none, of the meter's range


@dataclass(frozen=True, slots=True)
class Run:
    """Measured spool position (N,) [mm], counted motor position (N,) [mm], flow (N,) [1]."""

    spool: FloatArray
    motor: FloatArray
    flow: FloatArray


@dataclass(frozen=True, slots=True)
class Scan:
    """What a slow scan up and down shows: backlash, closed range [mm], regulated range [mm]."""

    backlash: float
    closed: tuple[float, float]
    regulated: tuple[float, float]


def follow(plant: StepperServoPlant, reference_mm: FloatArray, period_s: float) -> Run:
    """Run the valve with its controller under a reference that is held for each sample.

    Parameters
    ----------
    plant : StepperServoPlant
        The valve.
    reference_mm : (N,) array
        Wanted position [mm].
    period_s : float
        Sampling time [s].
    """
    reference = np.repeat(reference_mm * MM / plant.stroke, plant.ticks_per_sample(period_s))
    return _run(plant, reference, None, len(reference_mm), period_s)


def drive_open_loop(plant: StepperServoPlant, target_mm: FloatArray, period_s: float) -> Run:
    """Run the motor to given counts, at most a step in a base sample.

    Parameters
    ----------
    plant : StepperServoPlant
        The valve.
    target_mm : (N,) array
        Wanted motor position [mm].
    period_s : float
        Sampling time [s].
    """
    ticks = len(target_mm) * plant.ticks_per_sample(period_s)
    commands = np.column_stack([target_mm * MM / plant.stroke, np.zeros(len(target_mm))])
    return _run(plant, np.zeros(ticks), commands, len(target_mm), period_s)


def _run(
    plant: StepperServoPlant,
    reference: FloatArray,
    commands: FloatArray | None,
    samples: int,
    period_s: float,
) -> Run:
    drive = Drive(reference, np.zeros(len(reference), dtype=np.bool_), commands, np.zeros(samples))
    found = plant.run(plant.initial_state(), drive, period_s)
    scale = plant.stroke / MM
    return Run(scale * found.position, scale * found.inputs[:, 0], found.inputs[:, 1])


def scan(plant: StepperServoPlant) -> Scan:
    """Scan the working range up and down at one step in 2 s, as section 2.2 does."""
    held, step = round(_SLOW_S / _SCAN_S), plant.step_size / MM
    way = np.arange(10, 201) * step  # 0.1 to 2.0 mm
    target = np.repeat(np.concatenate([way, way[::-1]]), held)
    to_start = np.full(held, way[0])
    run = drive_open_loop(plant, np.concatenate([to_start, target]), _SCAN_S)
    last = held + held * np.arange(1, 2 * len(way) + 1) - 1
    spool, flow = run.spool[last], run.flow[last]
    up, down = slice(0, len(way)), slice(len(way), None)
    full = flow[up].max()
    closed = spool[up][flow[up] < _CLOSED * full]
    part = (flow[up] > _CLOSED * full) & (flow[up] < (1.0 - _CLOSED) * full)
    lower, upper = (spool[up][part & side] for side in (spool[up] < 1.0, spool[up] > 1.0))
    backlash = float(np.median(spool[down][::-1][20:-20] - spool[up][20:-20]))
    return Scan(
        backlash,
        (float(closed.min()), float(closed.max())),
        (float(np.ptp(lower)) + 2.0 * step, float(np.ptp(upper)) + 2.0 * step),
    )


def velocity_sweep(plant: StepperServoPlant) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Sweep the speed up, then down in the other direction (section 4, fig. 10).

    The delay between two steps begins at 100 samples and shrinks by 5 every 5 ms down to 1.

    Returns
    -------
    time_s, spool_mm, speed_mm_s : (N,) arrays
        Time [s], position [mm], speed between two steps of the motor [mm/s].
    """
    tick, step = plant.controller.period_s, plant.step_size / MM
    count = round(plant.initial_state()[0] * plant.stroke / plant.step_size)
    ramp = _EVERY_TICKS * (_SLOWEST_DELAY // _DELAY_STEP)
    target, speed, waited = [], [], 0
    for sign in (1, -1):
        shown = 0.0
        for n in range(ramp + _FULL_TICKS):
            delay = max(1, _SLOWEST_DELAY - _DELAY_STEP * (n // _EVERY_TICKS))
            waited += 1
            if waited >= delay:
                count, shown, waited = count + sign, sign * step / (waited * tick), 0
            target.append(count * step)
            speed.append(shown)
        waited = 0
    run = drive_open_loop(plant, np.array(target), tick)
    time_s: FloatArray = tick * np.arange(float(len(target)))
    return time_s, run.spool, np.array(speed)


def track_square(
    plant: StepperServoPlant, frequency_hz: float, ends_mm: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """Return reference and spool position (N,) [mm] of a square wave, every millisecond.

    Parameters
    ----------
    plant : StepperServoPlant
        The valve with its controller.
    frequency_hz : float
        Of the reference [Hz].
    ends_mm : tuple of float
        Both levels [mm].
    """
    time_s = plant.controller.period_s * np.arange(round(2.0 * SETTLED_S / 1e-3))
    high = np.sin(2.0 * np.pi * frequency_hz * time_s) >= 0.0
    reference: FloatArray = np.where(high, ends_mm[1], ends_mm[0])
    return reference, follow(plant, reference, plant.controller.period_s).spool
