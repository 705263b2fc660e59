# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Noise of the position sensor, measured where the valve rests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.data.kernels import rest_bends
from valve_twin.core.estimation.data.masks import Masks, contiguous, held_recently
from valve_twin.core.estimation.data.robust import robust_sigma

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, Frames

MIN_REST_SAMPLES = 20  # fewest second differences at rest that give a noise level [1]
_ROUNDING = 1e-12
_OUTLYING = 6.0  # of normal noise one second difference in 5e8 is as large [standard deviations]
_FEW = 0.15  # share of second differences from which on what is off is not single, three a sample


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
    frames: Frames,
    masks: Masks,
    *,
    active_command: float = 0.003,
    settle: int = 15,
    outliers: bool = True,
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
    outliers : bool
        Whether second differences count that white noise does not have; they do where they are
        not few.

    Returns
    -------
    RestNoise
        Standard deviation and count; sigma is NaN below `MIN_REST_SAMPLES`.
    """
    bends = np.empty(len(frames))
    total, count = rest_bends(
        contiguous(frames.position),
        contiguous(frames.inputs),
        masks.bad,
        masks.gap,
        masks.stale,
        masks.stuck,
        active_command,
        settle,
        bends,
    )
    if count < MIN_REST_SAMPLES:
        return RestNoise(float("nan"), count)
    if not outliers:
        size = np.abs(bends[:count])
        most = _OUTLYING * robust_sigma(size)  # none where most values repeat: it has steps
        kept = size[size <= most] if most > _ROUNDING else size
        kept = kept if len(kept) > (1.0 - _FEW) * count else size
        return RestNoise(float(np.sqrt(kept @ kept / len(kept) / 6.0)), len(kept))
    return RestNoise(float(np.sqrt(total / count / 6.0)), count)
