# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Products of long arrays on one thread.

A BLAS shares long ones among threads that wait for each other: on a busy machine a product of
20 000 values then takes milliseconds instead of microseconds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

_SMALL = 2**17
"""Multiplications up to which a BLAS keeps to one thread, half of OpenBLAS's bound [1]."""


def dot(u: FloatArray, v: FloatArray) -> float:
    """Return the scalar product of two (N,) arrays."""
    return float(np.sum(u * v))


def rows_times(rows: FloatArray, matrix: FloatArray) -> FloatArray:
    """Return (N, F) rows times a small (F, K) matrix, (N, K)."""
    out = np.empty((len(rows), matrix.shape[1]))
    size = max(_SMALL // max(matrix.size, 1), 1)
    for first in range(0, len(rows), size):
        part = slice(first, first + size)
        np.matmul(rows[part], matrix, out=out[part])
    return out
