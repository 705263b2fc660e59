# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled search of a minimum on an interval: parabolas kept safe by golden section (Brent 1973).

The loop belongs to the caller, who knows how to evaluate: `line_start`, then `line_next` until it
says NaN, each answered by `line_update`. The best place is `state[BEST]`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

BEST = 2
"""Where the best place stands in the state."""

BEST_VALUE = 5
"""And its value."""

_LOW, _HIGH, _SECOND, _THIRD, _SECOND_VALUE, _THIRD_VALUE, _STEP, _LAST = 0, 1, 3, 4, 6, 7, 8, 9
_SIZE = 10
_GOLDEN = 0.3819660112501051


@njit(cache=True)
def line_start(low: float, high: float, place: float, value: float) -> FloatArray:
    """Return the (10,) state of a search in [low, high] that begins at a place with its value.

    Parameters
    ----------
    low, high : float
        Ends of the search [any unit].
    place, value : float
        Where it begins [unit of the ends], and the value there [any unit].
    """
    state = np.zeros(_SIZE)
    state[_LOW], state[_HIGH] = low, high
    state[BEST] = state[_SECOND] = state[_THIRD] = place
    state[BEST_VALUE] = state[_SECOND_VALUE] = state[_THIRD_VALUE] = value
    return state


@njit(cache=True)
def line_next(state: FloatArray, width: float) -> float:
    """Return the place to try next; NaN once the minimum is known within `width`."""
    low, high, x = state[_LOW], state[_HIGH], state[BEST]
    middle = 0.5 * (low + high)
    if abs(x - middle) <= 2.0 * width - 0.5 * (high - low):
        return np.nan
    golden = True
    if abs(state[_LAST]) > width:
        to_second, to_third = x - state[_SECOND], x - state[_THIRD]
        r = to_second * (state[BEST_VALUE] - state[_THIRD_VALUE])
        q = to_third * (state[BEST_VALUE] - state[_SECOND_VALUE])
        top, bottom = to_third * q - to_second * r, 2.0 * (q - r)
        if bottom > 0.0:
            top = -top
        bottom = abs(bottom)
        before = state[_LAST]
        state[_LAST] = state[_STEP]
        inside = bottom * (low - x) < top < bottom * (high - x)
        if inside and abs(top) < abs(0.5 * bottom * before):
            golden = False
            state[_STEP] = top / bottom
            trial = x + state[_STEP]
            if trial - low < 2.0 * width or high - trial < 2.0 * width:
                state[_STEP] = width if middle > x else -width
    if golden:
        state[_LAST] = low - x if x >= middle else high - x
        state[_STEP] = _GOLDEN * state[_LAST]
    step = state[_STEP]
    if abs(step) < width:
        step = width if step > 0.0 else -width
    return float(x + step)


@njit(cache=True)
def line_update(state: FloatArray, place: float, value: float) -> None:
    """Take the value at the place that `line_next` asked for.

    Parameters
    ----------
    state : (10,) array
        State of the search, written in place; see `line_start`.
    place, value : float
        Place [unit of the ends] and the value there [any unit].
    """
    x = state[BEST]
    if value <= state[BEST_VALUE]:
        state[_LOW if place >= x else _HIGH] = x
        state[_THIRD], state[_THIRD_VALUE] = state[_SECOND], state[_SECOND_VALUE]
        state[_SECOND], state[_SECOND_VALUE] = x, state[BEST_VALUE]
        state[BEST], state[BEST_VALUE] = place, value
        return
    state[_LOW if place < x else _HIGH] = place
    if value <= state[_SECOND_VALUE] or state[_SECOND] == x:
        state[_THIRD], state[_THIRD_VALUE] = state[_SECOND], state[_SECOND_VALUE]
        state[_SECOND], state[_SECOND_VALUE] = place, value
    elif value <= state[_THIRD_VALUE] or state[_THIRD] == x or state[_THIRD] == state[_SECOND]:
        state[_THIRD], state[_THIRD_VALUE] = place, value
