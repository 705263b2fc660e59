# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled phases of a cycle: rest on a seat, leaving it, hold and motion."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray

_AWAY = 2
"""Samples beyond the margin of a seat until the spool has left it."""


class Limits(NamedTuple):
    """What tells the phases apart.

    Attributes
    ----------
    low, high : float
        Positions below and above which the spool is on a seat [1].
    margin : float
        Width of a seat [1].
    active : float
        Commands above it act [1].
    take_off : float
        Variance of the level once a seat is left, in units of the noise variance; infinite =
        unknown [1].
    settle : int
        Samples after the last command that count as motion.
    """

    low: float
    high: float
    margin: float
    active: float
    take_off: float
    settle: int


@njit(cache=True)
def delayed(command: FloatArray, delay: float) -> FloatArray:
    """Return the command `delay` samples old, see `acting_command`: (N,).

    Parameters
    ----------
    command : (N,) array
        Command of every sample [1].
    delay : float
        Not negative [samples].
    """
    lag = int(delay)
    part = delay - lag
    acting = np.empty(len(command))
    for n in range(len(command)):
        newer, older = command[max(n - lag, 0)], command[max(n - lag - 1, 0)]
        acting[n] = newer if part == 0.0 else (1.0 - part) * newer + part * older
    return acting


@njit(cache=True)
def mark_phases(
    position: FloatArray,
    stuck: BoolArray,
    broken: BoolArray,
    v_in: FloatArray,
    v_out: FloatArray,
    limits: Limits,
) -> tuple[BoolArray, BoolArray, BoolArray, BoolArray, FloatArray]:
    """Return what is seated, free, moving and leaving a seat, and the anchors, (N,) each.

    Parameters
    ----------
    position : (N,) array
        Measured position [1].
    stuck, broken : (N,) bool arrays
        See `Run`.
    v_in, v_out : (N,) arrays
        Commands that act at the sample [1].
    limits : Limits
        What tells the phases apart.
    """
    size = len(position)
    seated, free = np.empty(size, np.bool_), np.empty(size, np.bool_)
    moving, leaving = np.empty(size, np.bool_), np.zeros(size, np.bool_)
    anchor = np.zeros(size)
    driven = -limits.settle - 1
    for n in range(size):
        filled, emptied = v_in[n] > limits.active, v_out[n] > limits.active
        seated[n] = (position[n] <= limits.low and not filled) or (
            position[n] >= limits.high and not emptied
        )
        free[n] = not (seated[n] or stuck[n])
        driven = n if filled or emptied else driven
        moving[n] = n - driven <= limits.settle
    for last in range(size - 1):
        if not seated[last] or seated[last + 1]:
            continue
        away = last + 1
        while away < size and not (
            seated[away] or abs(position[away] - position[last]) > limits.margin
        ):
            away += 1
        end = min(away + _AWAY, size) - 1
        leaving[last + 1 : end] = True
        anchor[end] = limits.take_off
    for n in range(size):
        if broken[n] or stuck[n] or (n > 0 and seated[n] and not seated[n - 1]):
            anchor[n] = np.inf
    return seated, free, moving, leaving, anchor
