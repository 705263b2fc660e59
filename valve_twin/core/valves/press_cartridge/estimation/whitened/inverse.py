# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The inverse of normal equations, regular or not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.press_cartridge.estimation.whitened.moments import invert

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray, IntArray


def inverse_of(gram: FloatArray, which: IntArray) -> FloatArray:
    """Return the inverse of some rows and columns, the pseudo-inverse where they are singular.

    Parameters
    ----------
    gram : (P, P) array
        Positive semidefinite [1].
    which : (F,) int64 array
        Rows and columns; none of them is zero.

    Returns
    -------
    (F, F) array
        The inverse [1]; singular is meant of columns scaled to the same size.
    """
    inverse = np.empty((len(which), len(which)))
    if invert(gram, which, inverse):
        return inverse
    scale = np.sqrt(np.diag(gram)[which])
    scaled = gram[np.ix_(which, which)] / np.outer(scale, scale)
    return np.asarray(np.linalg.pinv(scaled, hermitian=True) / np.outer(scale, scale))
