# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Products of long arrays on one thread.

A BLAS shares long ones among threads that wait for each other: on a busy machine a product of
20 000 values then takes milliseconds instead of microseconds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray


def dot(u: FloatArray, v: FloatArray) -> float:
    """Return the scalar product of two (N,) arrays."""
    return float(np.sum(u * v))


def rows_times(rows: FloatArray, matrix: FloatArray) -> FloatArray:
    """Return (N, F) rows times a small (F, K) matrix, (N, K).

    The bits of a row do not depend on how many there are: a BLAS takes another way for one.
    """
    out = np.zeros((len(rows), matrix.shape[1]))
    _add_products(np.ascontiguousarray(rows), np.ascontiguousarray(matrix), out)
    return out


@njit(cache=True)
def _add_products(rows: FloatArray, matrix: FloatArray, out: FloatArray) -> None:
    """Add (N, F) rows times a (F, K) matrix to what stands in (N, K), feature by feature."""
    for n in range(len(rows)):
        for i in range(len(matrix)):
            for k in range(matrix.shape[1]):
                out[n, k] += rows[n, i] * matrix[i, k]
