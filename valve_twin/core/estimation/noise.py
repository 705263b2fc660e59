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

MIN_REST_SAMPLES = 20  # fewest differences at rest that give a noise level [1]


@dataclass(frozen=True, slots=True)
class RestNoise:
    """Noise floor of the position.

    Attributes
    ----------
    sigma : float
        Standard deviation of the position noise [1]; NaN where the cycle has no rest.
    samples : int
        Number of fresh samples at rest behind it.
    """

    sigma: float
    samples: int


def find_rest(
    frames: Frames, masks: Masks, *, active_command: float = 0.01, settle: int = 15
) -> BoolArray:
    """Return (N,) bool: no command has acted for `settle` samples.

    Parameters
    ----------
    frames : Frames
        Samples of one cycle.
    masks : Masks
        Its masks.
    active_command : float
        Command above which an input acts [1].
    settle : int
        Samples to wait after the last command, for lag and pole [samples].
    """
    acting = (np.abs(frames.inputs) > active_command).any(axis=1) | masks.bad
    return ~held_recently(acting, settle)


def rest_noise(
    frames: Frames, masks: Masks, *, active_command: float = 0.01, settle: int = 15
) -> RestNoise:
    """Measure the position noise at rest from first differences of fresh samples.

    A leak drifts in hold: each stretch of rest is freed of its mean difference, so that a constant
    drift does not count. Repeated values of a slow sensor are left out.

    Parameters
    ----------
    frames : Frames
        Samples of one cycle.
    masks : Masks
        Its masks.
    active_command : float
        Command above which an input acts [1].
    settle : int
        Samples to wait after the last command [samples].

    Returns
    -------
    RestNoise
        Standard deviation and sample count; sigma is NaN below `MIN_REST_SAMPLES`.
    """
    rest = find_rest(frames, masks, active_command=active_command, settle=settle)
    stretch = np.cumsum(~rest | masks.gap)
    fresh = rest & ~masks.stale & ~masks.bad & ~masks.stuck
    x, label = frames.position[fresh], stretch[fresh]
    same = label[1:] == label[:-1]
    step, label = np.diff(x)[same], label[1:][same]
    _, which, count = np.unique(label, return_inverse=True, return_counts=True)
    if count[count > 1].sum() < MIN_REST_SAMPLES:
        return RestNoise(float("nan"), len(step))
    mean = np.bincount(which, step) / count
    # a stretch of k white differences with their mean removed keeps 2 (k - 1/k) sigma^2: the mean
    # is telescoped
    expected = float(np.sum(2.0 * (count - 1.0 / count)))
    return RestNoise(float(np.sqrt(np.sum((step - mean[which]) ** 2) / expected)), len(step))
