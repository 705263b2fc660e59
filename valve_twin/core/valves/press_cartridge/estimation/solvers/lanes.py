# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What runs eight at once have in common: a lane of each response, and its normal equations.

A block of the work array holds one number of each lane. All is compiled into the loop over the
lanes that calls it: a loop is a vector only where all stands in it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

LANES = 8
"""Runs beside each other."""


@njit(cache=True, inline="always")
def follow(w: FloatArray, speed: int, gap: int, pole: float, push: float) -> None:
    """Move a response by one sample: the speed decays and is pushed, the gap grows by it.

    Parameters
    ----------
    w : (S,) array
        Work array [1].
    speed, gap : int
        Where both stand in it.
    pole, push : float
        Pole [1], what drives the speed, -0.0 = nothing [1].
    """
    w[speed] = pole * w[speed] + push
    w[gap] += w[speed]


@njit(cache=True, inline="always")
def weigh(w: FloatArray, at: int, a: float, b: float, c: float, d: float) -> float:
    """Return what inflow, its sag, outflow and its sag make of four columns.

    Parameters
    ----------
    w : (S,) array
        Work array [1].
    at : int
        Where the lane's parameters begin in it, a block each.
    a, b, c, d : float
        Columns [1].
    """
    return float(w[at] * a + w[at + 8] * b + w[at + 16] * c + w[at + 24] * d)


@njit(cache=True, inline="always")
def add_squares(
    w: FloatArray,
    at: int,
    weight: float,
    e0: float,
    e1: float,
    e2: float,
    e3: float,
    e4: float,
    e5: float,
    e6: float,
) -> None:
    """Add a row of seven columns to the lower triangle of its lane's normal equations.

    Parameters
    ----------
    w : (S,) array
        Work array [1].
    at : int
        Where the lane's triangle begins in it, row by row.
    weight : float
        Of the row [1].
    e0, e1, e2, e3, e4, e5, e6 : float
        The row [1].
    """
    x = weight * e0
    w[at] += x * e0
    x = weight * e1
    w[at + 8] += x * e0
    w[at + 16] += x * e1
    x = weight * e2
    w[at + 24] += x * e0
    w[at + 32] += x * e1
    w[at + 40] += x * e2
    x = weight * e3
    w[at + 48] += x * e0
    w[at + 56] += x * e1
    w[at + 64] += x * e2
    w[at + 72] += x * e3
    x = weight * e4
    w[at + 80] += x * e0
    w[at + 88] += x * e1
    w[at + 96] += x * e2
    w[at + 104] += x * e3
    w[at + 112] += x * e4
    x = weight * e5
    w[at + 120] += x * e0
    w[at + 128] += x * e1
    w[at + 136] += x * e2
    w[at + 144] += x * e3
    w[at + 152] += x * e4
    w[at + 160] += x * e5
    x = weight * e6
    w[at + 168] += x * e0
    w[at + 176] += x * e1
    w[at + 184] += x * e2
    w[at + 192] += x * e3
    w[at + 200] += x * e4
    w[at + 208] += x * e5
    w[at + 216] += x * e6
