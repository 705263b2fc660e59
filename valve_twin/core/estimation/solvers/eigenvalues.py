# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Eigenvalues of a Gram matrix of few columns, compiled."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

_SWEEPS = 30  # most Jacobi sweeps; five or six unless columns are nearly dependent


@njit(cache=True)
def extreme_eigenvalues(matrix: FloatArray) -> tuple[float, float]:
    """Return least and greatest eigenvalue of a Gram matrix scaled to a unit diagonal.

    By Jacobi rotations; columns of zeros are left out, (0, 0) where nothing is left.
    """
    columns = np.flatnonzero(np.diag(matrix) > 0.0)
    k = len(columns)
    if k == 0:
        return 0.0, 0.0
    a = np.empty((k, k))
    for i in range(k):
        for j in range(k):
            size = np.sqrt(matrix[columns[i], columns[i]]) * np.sqrt(
                matrix[columns[j], columns[j]]
            )
            a[i, j] = matrix[columns[i], columns[j]] / size
    for _ in range(_SWEEPS):
        off = 0.0
        for i in range(k):
            for j in range(i):
                off += a[i, j] * a[i, j]
        if off < 1e-36:
            break
        for i in range(1, k):
            for j in range(i):
                _rotate(a, i, j)
    return np.diag(a).min(), np.diag(a).max()


@njit(cache=True)
def _rotate(a: FloatArray, i: int, j: int) -> None:
    """Make the element (i, j) of a symmetric matrix zero by a rotation."""
    if a[i, j] == 0.0:
        return
    slope = (a[j, j] - a[i, i]) / (2.0 * a[i, j])
    tangent = 1.0 / (abs(slope) + np.sqrt(slope * slope + 1.0))
    if slope < 0.0:
        tangent = -tangent
    cosine = 1.0 / np.sqrt(tangent * tangent + 1.0)
    sine = tangent * cosine
    for n in range(len(a)):
        left, right = a[n, i], a[n, j]
        a[n, i], a[n, j] = cosine * left - sine * right, sine * left + cosine * right
    for n in range(len(a)):
        left, right = a[i, n], a[j, n]
        a[i, n], a[j, n] = cosine * left - sine * right, sine * left + cosine * right
