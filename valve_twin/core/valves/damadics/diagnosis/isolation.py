# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which fault it is: rules on signs and shapes, no number of the plant among them.

Inputs first (a pressure or the temperature left its healthy range), then the flow (what it does at
the measured position: a factor, an added flow, a wrong position), then the motion (how far the
position departs in the quarters of its way: rising below and above the middle, falling above and
below it). Faults that leave the same traces share one elementary diagnosis.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import trim_mean

from valve_twin.core.valves.damadics.diagnosis.motion_model import P1, P2, T1, X
from valve_twin.core.valves.damadics.diagnosis.statistics import (
    FLOW_WINDOWS,
    FREE_SCALE,
    INPUT_WINDOW,
    MOTION_VALUES,
    QUARTERS,
    STEP_SCALE,
)

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray, IntArray
    from valve_twin.core.valves.damadics.diagnosis.detector import Alarms, Detector


class Diagnosis(IntEnum):
    """Elementary diagnoses; `FAULTS` says which faults each holds."""

    NONE = 0
    STOP = 1
    LESS_FLOW = 2
    MORE_FLOW = 3
    FRICTION = 4
    ADDED_FLOW = 6
    WARM = 7
    LEAK_OR_DRIVE = 9
    DIAPHRAGM = 10
    SPRING = 11
    SENSOR = 13
    FEEDBACK = 15
    SUPPLY = 16
    PRESSURE = 17


UNDECIDED = -1
"""An alarm without a name yet."""

FAULTS: dict[Diagnosis, tuple[int, ...]] = {
    Diagnosis.NONE: (0, 8, 14),
    Diagnosis.STOP: (1,),
    Diagnosis.LESS_FLOW: (2, 5),
    Diagnosis.MORE_FLOW: (3, 19),
    Diagnosis.FRICTION: (4,),
    Diagnosis.ADDED_FLOW: (6, 18),
    Diagnosis.WARM: (7,),
    Diagnosis.LEAK_OR_DRIVE: (9, 12),
    Diagnosis.DIAPHRAGM: (10,),
    Diagnosis.SPRING: (11,),
    Diagnosis.SENSOR: (13,),
    Diagnosis.FEEDBACK: (15,),
    Diagnosis.SUPPLY: (16,),
    Diagnosis.PRESSURE: (17,),
}
"""Faults of the benchmark by elementary diagnosis; 0 = none, and those that nothing shows."""

EVERY = 10
"""Samples between two decisions on a name, assumed."""
WINDOW = 300
"""Most samples that a name rests on, assumed."""

_SURE = 5.0  # standard deviations of a mean flow that counts, assumed
_ENOUGH, _MOVED = 20, 60  # least samples of flow and of motion, assumed
_TRANSIENT = 15  # samples after the start of an alarm that the motion's shape leaves out, assumed
_FAR, _FLAT, _LEAST_FLAT = 3.0, 0.8, 5  # plateau: how far below, how flat, how many, assumed
_HELD_OFF, _STICKS, _SHORT = 15.0, 1.6, 8.0  # of the rules below, in healthy deviations, assumed
_TRIMMED = 0.1  # part of the samples left out at either end of a mean, assumed
_SLOWER, _EARLY = 0.36, 1.3  # ratios of quarters, assumed


def isolate(detector: Detector, alarms: Alarms, signals: FloatArray) -> IntArray:
    """Name the elementary diagnosis (N,) of signals (N, 6) [1] while there is an alarm.

    Parameters
    ----------
    detector : Detector
        What is healthy.
    alarms : Alarms
        What it says of the signals.
    signals : (N, 6) array
        Official signals [1].

    Returns
    -------
    (N,) int array
        Members of `Diagnosis`; NONE without an alarm, `UNDECIDED` with one that has no name yet.
    """
    out = np.zeros(len(signals), dtype=np.int64)
    start = -1
    name = UNDECIDED
    for n in range(len(signals)):
        if not alarms.high[n]:
            start, name = -1, UNDECIDED
            continue
        if start < 0:
            start = n
        if (n - start) % EVERY == 0:
            found = _name(detector, alarms, signals, start, n + 1)
            name = name if found == UNDECIDED else found
        out[n] = name
    return out


def _name(detector: Detector, alarms: Alarms, signals: FloatArray, start: int, end: int) -> int:
    last = slice(max(end - INPUT_WINDOW, 0), end)
    means = signals[last][:, [P1, P2, T1]].mean(axis=0)
    outside = (means < detector.limits.lower[-3:]) | (means > detector.limits.upper[-3:])
    if outside[2]:
        return Diagnosis.WARM
    if outside.any():
        return Diagnosis.PRESSURE
    begun = start + _TRANSIENT if end - start >= _MOVED else start
    first = max(begun, end - WINDOW)
    flow = _flow_name(detector, alarms, signals, slice(first, end))
    if flow != Diagnosis.NONE:
        return flow
    if end - start < _MOVED:
        return UNDECIDED
    return _motion_name(detector, alarms, signals, slice(first, end))


def _flow_name(detector: Detector, alarms: Alarms, signals: FloatArray, part: slice) -> int:
    """Return what the flow says; NONE if it is as expected."""
    flow = alarms.residuals.flow
    weight, ratio = flow.weight[part], flow.ratio[part]
    total = float(weight.sum())
    if total <= 0.0:
        return Diagnosis.NONE
    mean = float((weight * ratio).sum()) / total
    k = MOTION_VALUES + len(FLOW_WINDOWS) - 1
    least = _SURE / np.sqrt(total)
    if detector.limits.lower[k] - least < mean < detector.limits.upper[k] + least:
        return Diagnosis.NONE
    below = flow.below[part]
    if int(below.sum()) < _ENOUGH:
        saturated = len(weight) >= 2 * _MOVED and mean > 0.0
        return _saturated_name(detector, alarms, part) if saturated else UNDECIDED
    x = signals[part, X][below]
    root = np.sqrt(np.maximum(signals[part, P1] - signals[part, P2], 0.0))[below]
    return _flow_shape(ratio[below], weight[below], x, root / flow.expected[part][below])


def _saturated_name(detector: Detector, alarms: Alarms, part: slice) -> int:
    """Tell an added flow from a wrong position where the flow's sensor is at its end."""
    d = _departures(detector, alarms, part)[1]
    moved = np.abs(d).max() > 0.5 * detector.limits.centre[STEP_SCALE]
    return Diagnosis.SENSOR if moved else Diagnosis.ADDED_FLOW


def _flow_shape(ratio: FloatArray, weight: FloatArray, x: FloatArray, part: FloatArray) -> int:
    """Return which of three shapes the logarithm of the flow's ratio follows best.

    A factor; a position that is a factor wrong, of a valve of equal percentage; or an added flow,
    `part` of the expected one but for a factor.
    """
    factor = float((weight * ratio).sum() / weight.sum())
    slope = float((weight * ratio * x).sum() / (weight * x**2).sum())
    added = 0.0
    for _ in range(10):  # ratio = log(1 + added part), Gauss-Newton
        inside = np.maximum(1.0 + added * part, 0.05)
        gradient = part / inside
        error = ratio - np.log(inside)
        added += float((weight * gradient * error).sum() / (weight * gradient**2).sum())
    shapes = (
        (ratio - factor, Diagnosis.MORE_FLOW if factor > 0.0 else Diagnosis.LESS_FLOW),
        (ratio - slope * x, Diagnosis.SENSOR),
        (ratio - np.log(np.maximum(1.0 + added * part, 0.05)), Diagnosis.ADDED_FLOW),
    )
    return min(shapes, key=lambda shape: float((weight * shape[0] ** 2).sum()))[1]


def _departures(detector: Detector, alarms: Alarms, part: slice) -> tuple[FloatArray, FloatArray]:
    """Return by quarter how far both residuals depart from those before, or of a new valve."""
    middle = np.full((2, QUARTERS), np.nan)
    found = alarms.residuals
    quarter = found.quarter[part]
    for i, r in enumerate((found.free, found.step)):
        for k in range(QUARTERS):
            there = r[part][quarter == k]
            if len(there):
                middle[i, k] = trim_mean(there, _TRIMMED)
    new = middle - detector.limits.mean[-1].reshape(2, QUARTERS)
    before = middle - alarms.pattern[part.stop - 1].reshape(2, QUARTERS)
    sudden = np.nansum(before**2) > 0.25 * np.nansum(new**2)
    d = np.nan_to_num(before if sudden else new)
    return d[0], d[1]


def _motion_name(detector: Detector, alarms: Alarms, signals: FloatArray, part: slice) -> int:
    free, _ = _departures(detector, alarms, part)
    healthy = float(detector.limits.centre[FREE_SCALE])
    step_healthy = float(detector.limits.centre[STEP_SCALE])
    short = alarms.residuals.free[part] < -_FAR * healthy
    if int(short.sum()) >= _LEAST_FLAT:
        ends = signals[part, X][short]
        if 1.5 * np.median(np.abs(ends - np.median(ends))) < _FLAT * step_healthy:
            return Diagnosis.STOP
    rising_low, rising_high, falling_high, falling_low = free
    if free.min() > _HELD_OFF * healthy:
        return Diagnosis.FEEDBACK
    step, quarter = alarms.residuals.step[part], alarms.residuals.quarter[part]
    low = np.isin(quarter, (0.0, 3.0))
    if low.any() and (~low).any():
        rough = np.sqrt(np.mean(step[low] ** 2)) / np.sqrt(np.mean(step[~low] ** 2))
        if rough > _STICKS:
            return Diagnosis.FRICTION
    rising, falling = rising_low + rising_high, falling_low + falling_high
    if rising + falling < 0.0:
        if falling < _EARLY * rising:
            return Diagnosis.LEAK_OR_DRIVE
        slow = rising_high < -_SHORT * healthy and falling_low > 0.0
        return Diagnosis.DIAPHRAGM if slow else Diagnosis.SUPPLY
    return Diagnosis.DIAPHRAGM if rising < _SLOWER * falling else Diagnosis.SPRING
