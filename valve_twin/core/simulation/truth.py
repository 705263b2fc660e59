# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a cycle says about its operating point: the commands that did the moving."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray


def displacement_weighted_command(
    position: FloatArray, inputs: FloatArray, *, push: tuple[float, ...] = (1.0, -1.0)
) -> FloatArray:
    """Return each command's mean over a cycle, weighted with the displacement it caused.

    The steady gain depends on the command; this is the command at which a gain estimated from the cycle compares
    with the plant's steady gain.

    Parameters
    ----------
    position : (N,) array
        True position [1].
    inputs : (N, M) array
        Commands in force from each stamp on [1].
    push : tuple of float
        +1 for a command that raises the position, -1 for one that lowers it.

    Returns
    -------
    (M,) array
        Mean command [1]; NaN where a command moved nothing.
    """
    moved = np.diff(position)
    means = np.full(inputs.shape[1], np.nan)
    for j, sign in enumerate(push):
        command = inputs[:-1, j]
        weight = np.where(command > 0.0, np.maximum(sign * moved, 0.0), 0.0)
        if weight.sum() > 0.0:
            means[j] = float(weight @ command / weight.sum())
    return means
