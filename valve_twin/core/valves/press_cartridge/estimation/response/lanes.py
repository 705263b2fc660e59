# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The free run of eight poles and delays at once, with its sensitivities to both.

As `output_error_kernel.accumulate`, whose equations hold here, but each sample goes into eight
runs, one a lane of the machine's vectors. What weighs a sample is the same in all of them.

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

# first element of each block of `LANES` in the work array
_SPEED, _GAP = 0, 64  # five parameters, pole, delay; speed of the model behind them
GRAM = 120
"""Lower triangle of the (8, 8) normal equations, row by row: parameters, pole, delay, position."""

# what is asked, and the commands of a sample
POLE, DELAY, AT = 408, 416, 424
_IN, _OUT, _BY_IN, _BY_OUT = 464, 472, 480, 488
SIZE = 496
"""Length of the work array."""

_LATE = 6  # row of the delay in the normal equations
_FREE, _USE, _MOVING = 1, 2, 4
_OFTEN = 8  # samples until a product of weights becomes a logarithm


@njit(cache=True, error_model="numpy")
def run_lanes(  # noqa: PLR0912, PLR0915  a loop is a vector only where all stands in it
    y: FloatArray,
    flags: ByteArray,
    anchor: FloatArray,
    v_in: FloatArray,
    v_out: FloatArray,
    v_max: float,
    wander: float,
    w: FloatArray,
) -> tuple[float, int]:
    """Write the normal equations of eight free runs; return log determinant of weights, and rows.

    Parameters
    ----------
    y, anchor : (N,) arrays
        See `Stretch` [1].
    flags : (N,) uint8 array
        1 = free, 2 = use, 4 = moving, added.
    v_in, v_out : (N,) arrays
        Commands as given, without delay [1].
    v_max, wander : float
        Greatest command, random walk, see `accumulate` [1].
    w : (SIZE,) array
        Poles at `POLE` [1], delays at `DELAY` [samples], five parameters at `AT` [1]; the rest is
        overwritten.
    """
    for i in range(POLE):
        w[i] = 0.0
    variance = -1.0  # of the level, in units of the noise; negative = unknown
    place = 0.0  # of the measurement
    squares = 0.0
    product = 1.0  # of the weights
    log_determinant = 0.0
    rows = 0
    still = True  # no run differs from its level
    latest = 0
    for i in range(LANES):
        latest = max(latest, int(w[DELAY + i]) + 1)
    driven = 0  # the last sample with a command
    for n in range(len(y)):
        flag = flags[n]
        if anchor[n] > 0.0:
            known_still = variance >= 0.0 and anchor[n] < np.inf
            variance = variance + anchor[n] if known_still else -1.0
        driven = n if v_in[n] > 0.0 or v_out[n] > 0.0 else driven
        if flag & _FREE and n - driven > latest:
            still = False
            if flag & _MOVING:
                variance += wander if variance >= 0.0 else 0.0
            for i in range(LANES):
                z = w[POLE + i]
                share = 1.0 - z
                follow(w, _SPEED + i, _GAP + i, z, -0.0)
                follow(w, _SPEED + 8 + i, _GAP + 8 + i, z, -0.0)
                follow(w, _SPEED + 16 + i, _GAP + 16 + i, z, -0.0)
                follow(w, _SPEED + 24 + i, _GAP + 24 + i, z, -0.0)
                follow(w, _SPEED + 32 + i, _GAP + 32 + i, z, -share)
                pull = w[_SPEED + 56 + i] + w[AT + 32 + i]
                follow(w, _SPEED + 40 + i, _GAP + 40 + i, z, pull)
                follow(w, _SPEED + 48 + i, _GAP + 48 + i, z, -0.0)
                w[_SPEED + 56 + i] = z * w[_SPEED + 56 + i] - share * w[AT + 32 + i]
        elif flag & _FREE:
            still = False
            for i in range(LANES):
                late = int(w[DELAY + i])
                part = w[DELAY + i] - late
                newer, older = max(n - late, 0), max(n - late - 1, 0)
                w[_IN + i] = (1.0 - part) * v_in[newer] + part * v_in[older]
                w[_OUT + i] = (1.0 - part) * v_out[newer] + part * v_out[older]
                w[_BY_IN + i] = v_in[older] - v_in[newer]
                w[_BY_OUT + i] = v_out[older] - v_out[newer]
            for i in range(LANES):
                z = w[POLE + i]
                share = 1.0 - z
                a, c = w[_IN + i], -w[_OUT + i]
                b, d = a * (2.0 * v_max - a), c * (2.0 * v_max + c)
                by_a, by_c = w[_BY_IN + i], -w[_BY_OUT + i]
                by_b, by_d = by_a * (2.0 * v_max - 2.0 * a), by_c * (2.0 * v_max + 2.0 * c)
                drive = weigh(w, AT + i, a, b, c, d) - w[AT + 32 + i]
                by_drive = weigh(w, AT + i, by_a, by_b, by_c, by_d)
                follow(w, _SPEED + i, _GAP + i, z, share * a)
                follow(w, _SPEED + 8 + i, _GAP + 8 + i, z, share * b)
                follow(w, _SPEED + 16 + i, _GAP + 16 + i, z, share * c)
                follow(w, _SPEED + 24 + i, _GAP + 24 + i, z, share * d)
                follow(w, _SPEED + 32 + i, _GAP + 32 + i, z, -share)
                follow(w, _SPEED + 40 + i, _GAP + 40 + i, z, w[_SPEED + 56 + i] - drive)
                follow(w, _SPEED + 48 + i, _GAP + 48 + i, z, share * by_drive)
                w[_SPEED + 56 + i] = z * w[_SPEED + 56 + i] + share * drive
            if flag & _MOVING:
                variance += wander if variance >= 0.0 else 0.0
        elif not still:
            for i in range(_GAP):
                w[i] = 0.0
        if not flag & _USE:
            continue
        if variance < 0.0:
            for i in range(_GAP, GRAM):
                w[i] = 0.0
            still = not flag & _FREE
            place = y[n]
            variance = 1.0
            continue
        weight = 1.0 / (1.0 + variance)
        gain = variance * weight
        variance = gain
        product *= weight
        rows += 1
        if rows % _OFTEN == 0:
            log_determinant -= np.log(product)
            product = 1.0
        off = y[n] - place
        place += gain * off
        squares += weight * off * off
        if still:
            continue
        for i in range(LANES):
            e0 = w[_GAP + i]
            e1 = w[_GAP + 8 + i]
            e2 = w[_GAP + 16 + i]
            e3 = w[_GAP + 24 + i]
            e4 = w[_GAP + 32 + i]
            e5 = w[_GAP + 40 + i]
            e6 = w[_GAP + 48 + i]
            w[_GAP + i] = e0 - gain * e0
            w[_GAP + 8 + i] = e1 - gain * e1
            w[_GAP + 16 + i] = e2 - gain * e2
            w[_GAP + 24 + i] = e3 - gain * e3
            w[_GAP + 32 + i] = e4 - gain * e4
            w[_GAP + 40 + i] = e5 - gain * e5
            w[_GAP + 48 + i] = e6 - gain * e6
            add_squares(w, GRAM + i, weight, e0, e1, e2, e3, e4, e5, e6)
            x = weight * off
            w[GRAM + 224 + i] += x * e0
            w[GRAM + 232 + i] += x * e1
            w[GRAM + 240 + i] += x * e2
            w[GRAM + 248 + i] += x * e3
            w[GRAM + 256 + i] += x * e4
            w[GRAM + 264 + i] += x * e5
            w[GRAM + 272 + i] += x * e6
    for i in range(LANES):
        w[GRAM + 280 + i] = squares
    return log_determinant - np.log(product), rows


@njit(cache=True)
def read_lane(w: FloatArray, lane: int, gram: FloatArray) -> None:
    """Write the normal equations of one run, without those of the delay.

    Parameters
    ----------
    w : (SIZE,) array
        As `run_lanes` leaves it [1].
    lane : int
        Which run [1].
    gram : (7, 7) array
        Overwritten, as that of `accumulate` [1].
    """
    at = GRAM + lane
    for j in range(len(gram) + 1):
        for k in range(j + 1):
            if _LATE not in (j, k):
                row, column = j - (j > _LATE), k - (k > _LATE)
                gram[row, column] = gram[column, row] = w[at]
            at += LANES
