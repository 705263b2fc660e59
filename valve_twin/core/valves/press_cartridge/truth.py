# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The truth that estimates are judged by, computed from the plant."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.simulation.valve import SimulatedValve

if TYPE_CHECKING:
    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.types import FloatArray


@dataclass(frozen=True, slots=True)
class GainTruth:
    """True steady gains of one cycle.

    Attributes
    ----------
    commands : (M,) array
        Displacement-weighted mean of each command over the cycle [1].
    gains : (M,) array
        Steady gain of each command there, leak included: displacement a sample over
        the command [1].
    """

    commands: FloatArray
    gains: FloatArray


def cycle_truth(config: SimulationConfig, cycle: int) -> GainTruth:
    """Return the true gains of a production cycle of the aged plant, without scatter.

    Parameters
    ----------
    config : SimulationConfig
        The simulation; its measurement layer plays no part.
    cycle : int
        Cycle number.
    """
    plain = replace(config, controller="cycles", first_cycle=cycle, scatter=())
    valve = SimulatedValve(plain)
    block = valve.advance(plain.cycle_samples)
    commands = displacement_weighted_command(block.true_position, block.inputs)
    gains = [valve.steady_gain(cycle, v, input_index=i) for i, v in enumerate(commands)]
    return GainTruth(commands, np.array(gains))


def displacement_weighted_command(position: FloatArray, inputs: FloatArray) -> FloatArray:
    """Return each command's mean over a cycle, weighted with the displacement it caused.

    The steady gain depends on the command; this is the command at which a gain estimated from the
    cycle compares with the plant's steady gain.

    Parameters
    ----------
    position : (N,) array
        True position [1].
    inputs : (N, 2) array
        Inflow and outflow in force from each stamp on [1].

    Returns
    -------
    (2,) array
        Mean command [1]; NaN where a command moved nothing.
    """
    moved = np.diff(position)
    means = np.full(inputs.shape[1], np.nan)
    for j, sign in enumerate((1.0, -1.0)):
        command = inputs[:-1, j]
        weight = np.where(command > 0.0, np.maximum(sign * moved, 0.0), 0.0)
        if weight.sum() > 0.0:
            means[j] = float(weight @ command / weight.sum())
    return means
