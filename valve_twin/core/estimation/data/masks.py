# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which samples of a cycle say nothing about the valve: seat, stuck, stale and bad ones.

Position and command samples are only worth something to a fit while the spool answers the command.
Four masks take out the rest. They need no model, only the sign in which each command moves the
position (`push`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.data.kernels import mark_all
from valve_twin.core.estimation.data.stale import find_stale
from valve_twin.core.gaps import gap_ns

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray, Frames


@dataclass(frozen=True, slots=True)
class MaskOptions:
    """When a sample is masked.

    Attributes
    ----------
    lower_stop, upper_stop : float
        Position at the two stops [1].
    stop_margin : float
        Distance from a stop that counts as resting on it [1].
    active_command : float
        Command above which an input acts [1].
    max_lag : int
        Longest command to position lag considered [samples].
    stuck_command : float
        Net command that must move the spool [1].
    stuck_motion : float
        Motion between the two halves of the window below which the spool is stuck [1].
    stuck_window_s : float
        Length of that window [s].
    """

    lower_stop: float = 0.0
    upper_stop: float = 1.0
    stop_margin: float = 0.01
    active_command: float = 0.01
    max_lag: int = 4
    stuck_command: float = 0.1
    stuck_motion: float = 5e-4
    stuck_window_s: float = 0.6


@dataclass(frozen=True, slots=True)
class Masks:
    """Samples to leave out, one flag a sample.

    Attributes
    ----------
    seat : (N,) bool array
        Near a stop while the command pushes, or has just pushed, into it.
    stuck : (N,) bool array
        Clearly commanded off the stops without any motion.
    stale : (N,) bool array
        The sensor repeats an old value: the position is missing here.
    bad : (N,) bool array
        Not valid or not finite.
    gap : (N,) bool array
        At least one sample is missing before this one, or the stamp does not advance.
    refresh_period : float
        Mean time between fresh sensor values in motion [samples]; 1 = every sample is fresh.
    """

    seat: BoolArray
    stuck: BoolArray
    stale: BoolArray
    bad: BoolArray
    gap: BoolArray
    refresh_period: float = 1.0

    @property
    def any(self) -> BoolArray:
        """Return the samples whose position must not enter a fit: (N,) bool."""
        return self.seat | self.stuck | self.stale | self.bad


def find_masks(
    frames: Frames, period_s: float, *, push: tuple[float, ...], options: MaskOptions | None = None
) -> Masks:
    """Find the samples of a cycle that must not enter a fit.

    Parameters
    ----------
    frames : Frames
        Samples of one cycle (N may be 0).
    period_s : float
        Nominal sampling time of the position [s].
    push : tuple of float
        For each input +1 where it raises the position, -1 where it lowers it, 0 where it does
        neither.
    options : MaskOptions, optional
        Limits; the defaults of `MaskOptions` where omitted.

    Returns
    -------
    Masks
        One flag a sample and the refresh period of the sensor.

    Raises
    ------
    ValueError
        `push` does not have one entry an input.
    """
    options = options or MaskOptions()
    if frames.inputs.shape[1:] != (len(push),):
        msg = (
            f"push has {len(push)} entries, the frames have inputs of shape {frames.inputs.shape}"
        )
        raise ValueError(msg)
    n = len(frames)
    flags, found = np.zeros((6, n), np.bool_), np.empty((2, n))
    bad, gap, breaks, seat, stuck, stale = flags
    drive, x = found
    longest, any_stuck = mark_all(
        contiguous(frames.position),
        contiguous(frames.inputs),
        frames.valid,
        np.ascontiguousarray(frames.stamp_ns),
        gap_ns(period_s),
        np.asarray(push, float),
        (
            options.lower_stop + options.stop_margin,
            options.upper_stop - options.stop_margin,
            options.active_command,
            options.stuck_command,
            options.stuck_motion,
        ),
        (options.max_lag, max(6, round(options.stuck_window_s / period_s)) // 2),
        flags,
        found,
    )
    refresh = 1.0
    if longest > 1:
        active = np.abs(drive) > options.active_command
        stale, refresh = find_stale(x, active, breaks, max_lag=options.max_lag)
    if any_stuck:
        stuck &= ~seat & ~stale
    return Masks(seat, stuck, stale, bad, gap, refresh)


def contiguous(values: FloatArray) -> FloatArray:
    """Return the values in one piece, as the compiled passes want them."""
    return np.ascontiguousarray(values, dtype=np.float64)


def held_recently(flag: BoolArray, samples: int) -> BoolArray:
    """Return (N,) bool: `flag` holds at this sample or at one of the `samples` before it."""
    count = np.cumsum(flag)
    before = np.zeros_like(count)
    before[samples + 1 :] = count[: -samples - 1] if samples + 1 < len(count) else 0
    return np.asarray(count > before)
