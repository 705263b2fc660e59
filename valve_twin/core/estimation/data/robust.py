# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Scatter that a few outliers do not spoil."""

from __future__ import annotations

from math import comb, sqrt
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

MAD_SCALE = 1.4826
"""Standard deviation of a normal variable over its median absolute deviation."""

NORMAL_975 = 1.959963984540054
"""97.5 % point of the normal distribution."""


def robust_sigma(off: FloatArray) -> float:
    """Return the standard deviation of N deviations from their centre, by their median size."""
    return MAD_SCALE * float(np.median(np.abs(off)))


def difference_sigma(differences: FloatArray, order: int) -> float:
    """Return the standard deviation of white noise from its differences of an order, (N,).

    They have the variance binomial(2 order, order) over that of the noise; a smooth motion below
    has none.
    """
    return robust_sigma(differences) / sqrt(comb(2 * order, order))
