# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Take what can be fitted out of a cycle, and say why nothing can."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.prediction import percent
from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.valves.kit.record import held, longest_stretch, rest_refusal
from valve_twin.core.valves.stepper_servo.fit import Record
from valve_twin.core.valves.stepper_servo.predictor import MAX_LAG

if TYPE_CHECKING:
    from valve_twin.core.types import Cycle
    from valve_twin.core.valves.stepper_servo.fit import ThreadFit
    from valve_twin.core.valves.stepper_servo.parameters import StepperServoOptions

_LEAST_SAMPLES = 50
_QUIET = 1e-9  # change of the counted position that is none [1]
_SETTLE_SAMPLES = 5
_BELIEVED = 1e3  # a larger value is none: positions are parts of the stroke [1]


def take_record(cycle: Cycle) -> tuple[Record, int, int]:
    """Return the longest stretch without a gap, samples outside it, and bad ones inside."""
    frames = cycle.frames
    part = longest_stretch(frames, cycle.period_s)
    values = np.column_stack([part.position, part.inputs])
    used = part.valid & (np.abs(np.nan_to_num(values, nan=np.inf)) < _BELIEVED).all(axis=1)
    motor, flow = (held(part.inputs[:, i], used) for i in range(2))
    record = Record(held(part.position, used), motor, flow, used)
    return record, len(frames) - len(part), int(np.sum(~used))


def refusal_of(record: Record, options: StepperServoOptions) -> str:
    """Return why a record cannot be fitted, empty if it can."""
    usable = int(record.used.sum())
    if usable < _LEAST_SAMPLES:
        text = f"{usable} usable samples without a gap, fewer than the {_LEAST_SAMPLES} needed"
        return Refusal(RefusalCode.FEW_SAMPLES, text)
    position = record.position[record.used]
    rests = rest_refusal("the position moved by {} of the stroke", position, options.min_motion)
    if rests:
        return rests
    if float(np.ptp(record.motor)) == 0.0:
        text = f"motor_position stayed at {record.motor[0]:.3g}: the cycle excites nothing"
        return Refusal(RefusalCode.NOT_EXCITED, text)
    return ""


def misfit(record: Record, thread: ThreadFit, options: StepperServoOptions) -> str:
    """Return why a fitted thread is not trusted, empty if it is.

    Parameters
    ----------
    record : Record
        N samples without a gap.
    thread : ThreadFit
        What was fitted to it.
    options : StepperServoOptions
        The least fit.
    """
    y = record.position[record.used]
    fit = percent(float(np.sqrt(thread.cost)), float(np.sqrt(np.sum((y - y.mean()) ** 2))))
    least = options.min_fit
    if fit >= least:
        return ""
    text = (
        f"the screw explains {fit:.0f} % of the position, less than min_fit {least:g}: "
        "are motor_position and spool_position swapped, inverted or in another unit?"
    )
    return Refusal(RefusalCode.MISFIT, text)


def longest_delay(options: StepperServoOptions, period_s: float) -> float:
    """Return the longest delay to try [samples]."""
    return min(max(1.0, options.max_delay_s / period_s), float(MAX_LAG - 1))


def rest_noise(record: Record, lag: int) -> float:
    """Return the noise of the position where the motor has stood for a while [1]."""
    moved = np.abs(np.diff(record.motor, prepend=record.motor[:1])) > _QUIET
    last = np.maximum.accumulate(np.where(moved, np.arange(len(moved)), 0))
    rest = np.arange(len(moved)) - last > lag + _SETTLE_SAMPLES
    pairs = rest[1:] & rest[:-1] & record.used[1:] & record.used[:-1]
    if np.count_nonzero(pairs) < _LEAST_SAMPLES:
        return float("nan")
    return float(np.std(np.diff(record.position)[pairs]) / np.sqrt(2.0))
