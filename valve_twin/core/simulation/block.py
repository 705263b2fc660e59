# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a simulated valve gives out: blocks of samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from valve_twin.core.types import BoolArray, FloatArray, Frames, IntArray


@dataclass(frozen=True, slots=True)
class SimulationBlock:
    """N consecutive samples of a simulated valve.

    Attributes
    ----------
    stamp_ns : (N,) int64 array
        Simulated time [ns].
    cycle : (N,) int64 array
        Cycle number.
    reference : (N,) array
        Position reference [1]; NaN with external commands.
    inputs : (N, M) array
        Commands in force from the stamp on, as logged [1].
    position, true_position : (N,) arrays
        Measured and true position [1].
    delivered : (N,) bool array
        False where the sample is lost: it must not be published.
    """

    stamp_ns: IntArray
    cycle: IntArray
    reference: FloatArray
    inputs: FloatArray
    position: FloatArray
    true_position: FloatArray
    delivered: BoolArray

    def __len__(self) -> int:
        """Return the number of samples N."""
        return len(self.stamp_ns)


def to_frames(block: SimulationBlock) -> Frames:
    """Return the delivered samples of a block as frames, with cycle counter and reference."""
    kept = block.delivered
    return Frames(
        stamp_ns=block.stamp_ns[kept],
        position=block.position[kept],
        inputs=block.inputs[kept],
        counter=block.cycle[kept].astype(np.float64),
        reference=block.reference[kept],
        valid=np.ones(int(kept.sum()), dtype=np.bool_),
    )
