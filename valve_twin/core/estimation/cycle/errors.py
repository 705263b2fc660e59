# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled errors of a model over a cycle, with the bits of numpy's means and sums."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.cycle.scatter_kernel import sum_as_numpy
from valve_twin.core.types import Validity
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, ByteArray, FloatArray

_VALID = int(Validity.VALID)


@njit(cache=True, error_model="numpy")
def model_errors(
    y: FloatArray,
    valid: BoolArray,
    predicted: FloatArray,
    simulated: FloatArray,
    validity: ByteArray,
    least: int,
) -> tuple[float, float]:
    """Return one-step mean squared error [1] and free-run fit [%], as `evaluate` says.

    Parameters
    ----------
    y, predicted, simulated : (N,) arrays
        Measured position, one-step prediction and free run [1].
    valid : (N,) bool array
        Whether the sample is believed.
    validity : (N,) uint8 array
        One `Validity` a sample.
    least : int
        Fewer samples give NaN [1].
    """
    squares, known, off = np.empty(len(y)), np.empty(len(y)), np.empty(len(y))
    count = shown = 0
    for n in range(len(y)):
        if validity[n] == _VALID and np.isfinite(predicted[n]):
            squares[count] = (y[n] - predicted[n]) ** 2
            count += 1
        if valid[n] and np.isfinite(y[n]) and np.isfinite(simulated[n]):
            known[shown], off[shown] = y[n], (y[n] - simulated[n]) ** 2
            shown += 1
    mse = sum_as_numpy(squares[:count]) / count if count >= least else np.nan
    if shown < least:
        return mse, np.nan
    known = known[:shown]
    spread = np.sqrt(sum_as_numpy((known - sum_as_numpy(known) / shown) ** 2))
    miss = np.sqrt(sum_as_numpy(off[:shown]))
    return mse, 100.0 * (1.0 - miss / spread) if spread > 0.0 else np.nan
