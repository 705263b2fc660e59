# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Take what can be fitted out of a cycle, and say why nothing can."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.data.robust import difference_sigma
from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.valves.kit.record import rest_refusal
from valve_twin.core.valves.servo_system.plant_kernel import INPUTS

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, Cycle, FloatArray
    from valve_twin.core.valves.servo_system.parameters import ServoSystemOptions

SIGNALS = ("piston_position", *INPUTS[1:])
"""What is fitted, in this order."""

SLOWEST_PERIOD_S = 2e-3
"""Slowest sampling from which a cycle is estimated: modes at about 100 Hz [s], assumed."""

_FEWEST = 200  # fewest usable samples of a cycle, assumed
_LEAST_SHARE = 0.8  # of a signal's samples that must be usable [1], assumed
_BELIEVED = 10.0  # a larger value is none: signals are parts of their full scales [1]
_LONGEST_GAP = 20  # samples over which the desired position is held, assumed
_FLOOR = 1e-4
"""Smallest error that a signal is given, of full scale: the integration's [1]."""


@dataclass(frozen=True, slots=True)
class Record:
    """What is fitted.

    Attributes
    ----------
    wanted : (N,) array
        Desired position on a grid without gaps [1].
    measured : (N, 9) array
        `SIGNALS`, 0 where unusable [1].
    weight : (N, 9) array
        1 over the noise of the signal, 0 where unusable.
    sigma : (9,) array
        Noise of the signals [1].
    period_s : float
        Sampling time [s].
    bad : int
        Samples with something unusable.
    """

    wanted: FloatArray
    measured: FloatArray
    weight: FloatArray
    sigma: FloatArray
    period_s: float
    bad: int


def take_record(cycle: Cycle) -> tuple[Record | None, str]:
    """Return what can be fitted, or None and why nothing can.

    Parameters
    ----------
    cycle : Cycle
        One cycle that begins at rest.
    """
    if cycle.period_s > SLOWEST_PERIOD_S:
        text = (
            f"sampled every {cycle.period_s:g} s: the modes of structure and fluid need a "
            f"period_s from 0 to {SLOWEST_PERIOD_S:g} s"
        )
        return None, Refusal(RefusalCode.WRONG_PERIOD, text)
    frames = cycle.frames
    index = np.round((frames.stamp_ns - frames.stamp_ns[0]) / (1e9 * cycle.period_s))
    index = index.astype(np.int64)
    missing = int(np.diff(index).max(initial=1)) - 1
    if missing > _LONGEST_GAP:
        text = (
            f"a gap of {missing} samples, more than {_LONGEST_GAP}: what was wanted there is "
            "not known"
        )
        return None, Refusal(RefusalCode.GAPS, text)
    bad = len(frames) - int(np.count_nonzero(frames.valid))
    if bad > (1.0 - _LEAST_SHARE) * len(frames):
        text = f"{bad} of {len(frames)} samples are not valid"
        return None, Refusal(RefusalCode.FEW_SAMPLES, text)
    values = np.full((int(index[-1]) + 1, len(INPUTS) + 1), np.nan)
    values[index, 0] = frames.position
    values[index, 1:] = frames.inputs
    values[~(np.abs(values) < _BELIEVED)] = np.nan
    columns = np.delete(values, 1, axis=1)
    usable = np.isfinite(columns)
    refusal = _refusal(usable, np.isfinite(values[:, 1]))
    if refusal:
        return None, refusal
    sigma = np.array([_noise(columns[:, j]) for j in range(columns.shape[1])])
    return Record(
        wanted=_held(values[:, 1]),
        measured=np.nan_to_num(columns),
        weight=usable / sigma,
        sigma=sigma,
        period_s=cycle.period_s,
        bad=int(np.sum(~usable.all(axis=1))),
    ), ""


def excitation_of(record: Record, options: ServoSystemOptions) -> str:
    """Return why a record shows nothing, empty if it moves enough."""
    y = record.measured[record.weight[:, 0] > 0.0, 0]
    return rest_refusal("the piston moved by {} of the stroke", y, options.min_motion)


def _refusal(usable: BoolArray, wanted: BoolArray) -> str:
    count = len(usable)
    if count < _FEWEST:
        return Refusal(RefusalCode.FEW_SAMPLES, f"{count} samples, fewer than {_FEWEST}")
    shares = dict(zip(SIGNALS, usable.mean(axis=0), strict=True))
    shares[INPUTS[0]] = wanted.mean()
    for name, share in shares.items():
        if share < _LEAST_SHARE:
            bad = round((1.0 - share) * count)
            text = (
                f"{name}: {bad} of {count} values are missing, no numbers or beyond "
                f"{_BELIEVED:g}; {_LEAST_SHARE:g} of them must be usable"
            )
            return Refusal(RefusalCode.FEW_SAMPLES, text)
    return ""


def _held(values: FloatArray) -> FloatArray:
    """Return values in which the last usable one stands for unusable ones."""
    known = np.isfinite(values)
    first = int(np.argmax(known))
    index = np.maximum.accumulate(np.where(known, np.arange(len(values)), first))
    return np.ascontiguousarray(values[index])


def _noise(values: FloatArray) -> float:
    """Return the noise of a signal from its third differences, at least what its steps leave."""
    third = np.diff(values, 3)
    third = third[np.isfinite(third)]
    sigma = difference_sigma(third, 3) if len(third) else 0.0
    steps = np.abs(np.diff(values))
    steps = steps[np.isfinite(steps) & (steps > 1e-9)]
    least = float(steps.min()) / np.sqrt(12.0) if len(steps) else 0.0
    return max(sigma, min(least, 1e-2), _FLOOR)
