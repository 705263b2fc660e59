# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The Kalman whitening of eight poles and noise ratios at once, with its derivative by the pole.

As `kalman_kernel.whiten`, whose equations hold here, but a sample goes into eight filters, one a
lane of the machine's vectors: eight cost what one did. Level and place of a response matter as
their difference only, speed and drift likewise, so two states a column are enough and large levels
do not cancel. The likelihood of the residual at given parameters is differentiated by the pole,
through response and filter, beside it.

No operation joins two lanes, so the bits of one do not depend on the others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.press_cartridge.estimation.solvers.lanes import (
    LANES,
    add_squares,
    follow,
    weigh,
)
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import ByteArray, FloatArray

# first element of each block of `LANES` in the work array: states of the columns
_SPEED, _TURN, _GAP = 0, 56, 112  # five parameters, the sensitivity to the pole, the residual
_SLOPE_TURN, _SLOPE_GAP = 168, 176  # derivatives of the residual's by the pole
_PLACE, _DRIFT = 184, 192  # of the measurement
_P11, _P12, _P22, _D11, _D12, _D22 = 200, 208, 216, 224, 232, 240
# what is summed
_PRODUCT, LOG_TOTAL, BY_POLE, BY_POLE_TOTAL, SQUARES, SQUARES_TOTAL = 248, 256, 264, 272, 280, 288
GRAM = 296
"""Lower triangle of the (7, 7) normal equations, row by row."""

# what is asked
POLE, RATIO, AT = 520, 528, 536
SIZE = 576
"""Length of the work array."""

_FREE, _USE, _MOVING = 1, 2, 4
_OFTEN = 8  # samples until a product of variances becomes a logarithm


@njit(cache=True, inline="always")
def _drive(w: FloatArray, at: int, pole: float, push: float) -> None:
    """Move the response of a column, and what the filter has it turn by."""
    w[_SPEED + at] = pole * w[_SPEED + at] + push
    follow(w, _TURN + at, _GAP + at, pole, push)


@njit(cache=True, inline="always")
def _correct(w: FloatArray, at: int, gap: float, gain: float, turn: float) -> None:
    """Take a column's innovation into the state of its filter."""
    w[_GAP + at] = gap - gain * gap
    w[_TURN + at] -= turn * gap


@njit(cache=True, error_model="numpy")
def whiten_lanes(  # noqa: PLR0912, PLR0915  a loop is a vector only where all stands in it
    y: FloatArray,
    flags: ByteArray,
    anchor: FloatArray,
    v_in: FloatArray,
    v_out: FloatArray,
    v_max: float,
    w: FloatArray,
) -> int:
    """Write normal equations and derivatives for eight poles and ratios; return the rows.

    Parameters
    ----------
    y, anchor, v_in, v_out : (N,) arrays
        See `Stretch` [1].
    flags : (N,) uint8 array
        1 = free, 2 = use, 4 = moving, added.
    v_max : float
        Greatest command [1].
    w : (SIZE,) array
        Poles at `POLE`, ratios at `RATIO`, five parameters at `AT` [1]; the rest is overwritten.
    """
    for i in range(POLE):
        w[i] = 0.0
    for i in range(LANES):
        w[_PRODUCT + i] = 1.0
    known = False
    rows = 0
    for n in range(len(y)):
        flag = flags[n]
        if anchor[n] > 0.0:
            if anchor[n] < np.inf:
                for i in range(LANES):
                    w[_P11 + i] += anchor[n]
            else:
                known = False
                for i in range(7 * LANES):
                    w[_TURN + i] = w[_SPEED + i]
                for i in range(LANES):
                    w[_TURN + 48 + i] = -w[_SPEED + 48 + i]
                    w[_SLOPE_TURN + i] = -w[_SPEED + 40 + i]
                    w[_DRIFT + i] = 0.0
                    w[_P12 + i] = w[_P22 + i] = w[_D12 + i] = w[_D22 + i] = 0.0
        if flag & _FREE:
            a, c = v_in[n], -v_out[n]
            b, d = a * (2.0 * v_max - a), c * (2.0 * v_max + c)
            on = 1.0 if flag & _MOVING else 0.0
            for i in range(LANES):
                z = w[POLE + i]
                share = 1.0 - z
                drive = weigh(w, AT + i, a, b, c, d) - w[AT + 32 + i]
                pull = w[_SPEED + 48 + i] - drive
                # parameters
                _drive(w, i, z, share * a)
                _drive(w, 8 + i, z, share * b)
                _drive(w, 16 + i, z, share * c)
                _drive(w, 24 + i, z, share * d)
                _drive(w, 32 + i, z, -share)
                # the sensitivity to the pole
                _drive(w, 40 + i, z, pull)
                # the residual, whose speed counts upwards, and its derivative
                turn = w[_TURN + 48 + i]
                slope = z * w[_SLOPE_TURN + i] + turn + drive
                w[_SLOPE_TURN + i] = slope
                w[_SLOPE_GAP + i] += slope
                s = share * drive
                w[_SPEED + 48 + i] = z * w[_SPEED + 48 + i] + s
                turn = z * turn - s
                w[_TURN + 48 + i] = turn
                w[_GAP + 48 + i] += turn
                # the measurement
                follow(w, _DRIFT + i, _PLACE + i, z, -0.0)
                # covariance and its derivative
                p12, p22, d12, d22 = w[_P12 + i], w[_P22 + i], w[_D12 + i], w[_D22 + i]
                u, du = z * p12, p12 + z * d12
                v, dv = z * z * p22 + on * w[RATIO + i], 2.0 * z * p22 + z * z * d22
                w[_P11 + i] += 2.0 * u + v
                w[_P12 + i] = u + v
                w[_P22 + i] = v
                w[_D11 + i] += 2.0 * du + dv
                w[_D12 + i] = du + dv
                w[_D22 + i] = dv
        else:
            for i in range(_GAP):
                w[i] = 0.0
            for i in range(LANES):
                w[_DRIFT + i] = w[_SLOPE_TURN + i] = 0.0
                w[_P12 + i] = w[_P22 + i] = w[_D12 + i] = w[_D22 + i] = 0.0
        if not flag & _USE:
            continue
        yn = y[n]
        if not known:
            known = True
            for i in range(7 * LANES):
                w[_GAP + i] = 0.0
            for i in range(LANES):
                w[_SLOPE_GAP + i] = w[_D11 + i] = w[_P12 + i] = w[_D12 + i] = 0.0
                w[_P11 + i] = 1.0
                w[_PLACE + i] = yn
            continue
        rows += 1
        for i in range(LANES):
            p11, p12, d11, d12 = w[_P11 + i], w[_P12 + i], w[_D11 + i], w[_D12 + i]
            total = 1.0 + p11
            inverse = 1.0 / total
            gain, turn = p11 * inverse, p12 * inverse
            by_total = d11 * inverse
            by_gain = by_total * inverse
            by_turn = d12 * inverse - turn * by_total
            w[_PRODUCT + i] *= total
            w[_P11 + i] = gain
            w[_P12 + i] = p12 - gain * p12
            w[_P22 + i] = w[_P22 + i] - turn * p12
            w[_D11 + i] = by_gain
            w[_D12 + i] = by_turn
            w[_D22 + i] = w[_D22 + i] - by_turn * p12 - turn * d12
            e0, e1, e2 = w[_GAP + i], w[_GAP + 8 + i], w[_GAP + 16 + i]
            e3, e4, e5 = w[_GAP + 24 + i], w[_GAP + 32 + i], w[_GAP + 40 + i]
            e6 = yn - w[_PLACE + i]
            left = e6 - (weigh(w, AT + i, e0, e1, e2, e3) + w[AT + 32 + i] * e4)
            _correct(w, i, e0, gain, turn)
            _correct(w, 8 + i, e1, gain, turn)
            _correct(w, 16 + i, e2, gain, turn)
            _correct(w, 24 + i, e3, gain, turn)
            _correct(w, 32 + i, e4, gain, turn)
            _correct(w, 40 + i, e5, gain, turn)
            w[_PLACE + i] += gain * e6
            w[_DRIFT + i] += turn * e6
            slope = w[_SLOPE_GAP + i]
            w[_TURN + 48 + i] -= turn * left
            w[_SLOPE_GAP + i] = slope - gain * slope - by_gain * left
            w[_SLOPE_TURN + i] -= turn * slope + by_turn * left
            weighted = left * inverse
            w[BY_POLE + i] += weighted * (2.0 * slope - by_total * left)
            w[BY_POLE_TOTAL + i] += by_total
            w[SQUARES + i] += slope * slope * inverse
            w[SQUARES_TOTAL + i] += by_total * by_total
            add_squares(w, GRAM + i, inverse, e0, e1, e2, e3, e4, e5, e6)
        if rows % _OFTEN == 0:
            for i in range(LANES):
                w[LOG_TOTAL + i] += np.log(w[_PRODUCT + i])
                w[_PRODUCT + i] = 1.0
    for i in range(LANES):
        w[LOG_TOTAL + i] += np.log(w[_PRODUCT + i])
    return rows
