# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Noise of the position sensor, measured where the valve rests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.masks import Masks, held_recently

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, Frames

MIN_REST_SAMPLES = 20  # fewest second differences at rest that give a noise level [1]


@dataclass(frozen=True, slots=True)
class RestNoise:
    """Noise floor of the position.

    Attributes
    ----------
    sigma : float
        Standard deviation of the position noise [1]; NaN where the cycle has no rest.
    samples : int
        Number of second differences of fresh samples behind it.
    """

    sigma: float
    samples: int


def find_rest(
    frames: Frames, masks: Masks, *, active_command: float = 0.003, settle: int = 15
) -> BoolArray:
    """Return (N,) bool: no command has acted for `settle` samples.

    Parameters
    ----------
    frames : Frames
        Samples of one cycle.
    masks : Masks
        Its masks.
    active_command : float
        Command above which an input moves the spool at all [1].
    settle : int
        Samples to wait after the last command, for lag and pole [samples].
    """
    acting = (np.abs(frames.inputs) > active_command).any(axis=1) | masks.bad
    return ~held_recently(acting, settle)


def rest_noise(
    frames: Frames, masks: Masks, *, active_command: float = 0.003, settle: int = 15
) -> RestNoise:
    """Measure the position noise at rest from second differences of fresh samples.

    White noise of deviation sigma has second differences of variance 6 sigma^2, and a drift (a
    leak in hold, which ends on the seat) has none. Repeated values of a slow sensor are left out.

    Parameters
    ----------
    frames : Frames
        Samples of one cycle.
    masks : Masks
        Its masks.
    active_command : float
        Command above which an input moves the spool at all [1].
    settle : int
        Samples to wait after the last command [samples].

    Returns
    -------
    RestNoise
        Standard deviation and count; sigma is NaN below `MIN_REST_SAMPLES`.
    """
    rest = find_rest(frames, masks, active_command=active_command, settle=settle)
    stretch = np.cumsum(~rest | masks.gap)
    fresh = rest & ~masks.stale & ~masks.bad & ~masks.stuck
    x, label = frames.position[fresh], stretch[fresh]
    bend = np.diff(x, 2)[label[2:] == label[:-2]]
    if len(bend) < MIN_REST_SAMPLES:
        return RestNoise(float("nan"), len(bend))
    return RestNoise(float(np.sqrt(np.mean(bend**2) / 6.0)), len(bend))
