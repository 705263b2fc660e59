# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What values that repeat tell of a sensor: its noise decides.

A sensor whose steps hide its noise shows a frozen value and a stem that stands still alike. One
whose noise is larger than its steps repeats a value of a resting stem by chance alone, so that
more of them are no stem.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.generic.motion import motion_from

if TYPE_CHECKING:
    from valve_twin.core.past.columns import Rows

HIDDEN = 0.35
"""Noise over the step of the sensor up to which rounding hides it, assumed: rounding alone counts
as 0.29 [1]."""

_SHOWN = 0.6
"""The same from which on it is seen, assumed: what a slow motion makes of steps is below 0.52."""

_MORE = 0.1
"""Share of values by which more repeat than by chance where the sensor is frozen, assumed [1]."""


def noise_of(features: Rows) -> float:
    """Return the noise of a sensor over its step, NaN where not known [1].

    Parameters
    ----------
    features : Rows
        Features of the cycles: some tens of them hold the valve's own motion.
    """
    held = [features.motions[k] for k in features.key.tolist() if k in features.motions]
    if not held:
        return math.nan
    motion = motion_from(held[-1])
    return motion.noise / motion.step if motion.step > 0.0 else math.inf


def is_hidden(features: Rows) -> bool:
    """Return whether the steps of a sensor hide its noise, False where not known."""
    return noise_of(features) <= HIDDEN


def repeated_at_rest(noise: float) -> float:
    """Return the greatest share of values that repeat while the stem stands still [1].

    Parameters
    ----------
    noise : float
        Standard deviation of the sensor over its step, normal [1]; the stem in mid-step.
    """
    edges = np.arange(-0.5, max(8.0 * noise, 1.0), 1.0)
    below = np.array([0.5 * math.erfc(-x / (noise * math.sqrt(2.0))) for x in edges])
    beside = np.diff(below)
    return float(beside[0] ** 2 + 2.0 * np.sum(beside[1:] ** 2))


def frozen_share(noise: float, before: float, now: float) -> float:
    """Return the share of values that a sensor froze for, 0 where a resting stem may be it.

    Parameters
    ----------
    noise : float
        Of the sensor over its step [1].
    before, now : float
        Greatest share of values that repeated in a cycle before, and their share since [1].
    """
    if not noise >= _SHOWN:
        return 0.0
    chance = 0.0 if math.isinf(noise) else repeated_at_rest(noise)
    usual = max(before, chance)
    return (now - usual) / (1.0 - usual) if now - usual > _MORE else 0.0
