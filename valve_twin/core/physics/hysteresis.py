# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Rate-independent hysteresis of Prandtl and Ishlinskii: a weighted sum of plays.

Each play holds an output z within its reach r of the input u: z = clip(z, u - r, u + r). The sum
has return-point memory and wiping-out: a minor loop closes exactly, and a larger excursion erases
what smaller ones left. Bouc and Wen's equation has neither (its minor loops miss by 4 % of full
scale), so it cannot give the major and minor loops that paper 003 asks for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

PLAYS = 8
"""Plays of the sum; their reaches are equally spaced up to the largest."""


@njit(cache=True)
def output(
    u: float, way: float, memory: FloatArray, reach: float, share: float
) -> tuple[float, float]:
    """Return the hysteretic output for an input, and its slope; the memory stays as it is.

    Parameters
    ----------
    u : float
        Input [any unit], monotone since the memory was last written.
    way : float
        Rate of the input [unit of u / s]: its sign decides the slope of a play on its edge.
    memory : (PLAYS,) array
        Outputs of the plays [unit of u].
    reach : float
        Largest reach of a play [unit of u].
    share : float
        Weight of all plays together, below 1 [1]; the rest follows the input.
    """
    count = len(memory)
    total, moving = 0.0, 0
    for k in range(count):
        r = reach * (k + 1) / count
        z = memory[k]
        moving += (z <= u - r and way > 0.0) or (z >= u + r and way < 0.0)
        z = min(max(z, u - r), u + r)
        total += z
    return (1.0 - share) * u + share * total / count, 1.0 - share + share * moving / count


@njit(cache=True)
def remember(u: float, memory: FloatArray, reach: float) -> None:
    """Write the memory after the input has gone monotonically to `u`.

    Parameters
    ----------
    u : float
        Input [any unit].
    memory : (PLAYS,) array
        Outputs of the plays, written in place [unit of u].
    reach : float
        Largest reach of a play [unit of u].
    """
    count = len(memory)
    for k in range(count):
        r = reach * (k + 1) / count
        memory[k] = min(max(memory[k], u - r), u + r)


@njit(cache=True)
def mean_reach(reach: float) -> float:
    """Return the mean reach of the plays: `share` times this is half the width of a large loop."""
    return 0.5 * reach * (PLAYS + 1) / PLAYS
