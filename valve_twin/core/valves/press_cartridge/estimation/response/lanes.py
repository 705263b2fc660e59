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

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import ByteArray, FloatArray

LANES = 8
"""Runs beside each other."""

# first element of each block of `LANES` in the work array
_SPEED, _GAP = 0, 64  # five parameters, pole, delay; speed of the model behind them
GRAM = 120
"""Lower triangle of the (8, 8) normal equations, row by row: parameters, pole, delay, position."""

# what is asked, and the commands of a sample
POLE, DELAY, AT = 408, 416, 424
_IN, _OUT, _BY_IN, _BY_OUT = 464, 472, 480, 488
SIZE = 496
"""Length of the work array."""

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
                speed = z * w[_SPEED + i]
                w[_SPEED + i] = speed
                w[_GAP + i] += speed
                speed = z * w[_SPEED + 8 + i]
                w[_SPEED + 8 + i] = speed
                w[_GAP + 8 + i] += speed
                speed = z * w[_SPEED + 16 + i]
                w[_SPEED + 16 + i] = speed
                w[_GAP + 16 + i] += speed
                speed = z * w[_SPEED + 24 + i]
                w[_SPEED + 24 + i] = speed
                w[_GAP + 24 + i] += speed
                speed = z * w[_SPEED + 32 + i] - share
                w[_SPEED + 32 + i] = speed
                w[_GAP + 32 + i] += speed
                pull = w[_SPEED + 56 + i] + w[AT + 32 + i]
                speed = z * w[_SPEED + 40 + i] + pull
                w[_SPEED + 40 + i] = speed
                w[_GAP + 40 + i] += speed
                speed = z * w[_SPEED + 48 + i]
                w[_SPEED + 48 + i] = speed
                w[_GAP + 48 + i] += speed
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
                drive = (
                    w[AT + i] * a
                    + w[AT + 8 + i] * b
                    + w[AT + 16 + i] * c
                    + w[AT + 24 + i] * d
                    - w[AT + 32 + i]
                )
                by_drive = (
                    w[AT + i] * by_a
                    + w[AT + 8 + i] * by_b
                    + w[AT + 16 + i] * by_c
                    + w[AT + 24 + i] * by_d
                )
                speed = z * w[_SPEED + i] + share * a
                w[_SPEED + i] = speed
                w[_GAP + i] += speed
                speed = z * w[_SPEED + 8 + i] + share * b
                w[_SPEED + 8 + i] = speed
                w[_GAP + 8 + i] += speed
                speed = z * w[_SPEED + 16 + i] + share * c
                w[_SPEED + 16 + i] = speed
                w[_GAP + 16 + i] += speed
                speed = z * w[_SPEED + 24 + i] + share * d
                w[_SPEED + 24 + i] = speed
                w[_GAP + 24 + i] += speed
                speed = z * w[_SPEED + 32 + i] - share
                w[_SPEED + 32 + i] = speed
                w[_GAP + 32 + i] += speed
                speed = z * w[_SPEED + 40 + i] + (w[_SPEED + 56 + i] - drive)
                w[_SPEED + 40 + i] = speed
                w[_GAP + 40 + i] += speed
                speed = z * w[_SPEED + 48 + i] + share * by_drive
                w[_SPEED + 48 + i] = speed
                w[_GAP + 48 + i] += speed
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
            x = weight * e0
            w[GRAM + i] += x * e0
            x = weight * e1
            w[GRAM + 8 + i] += x * e0
            w[GRAM + 16 + i] += x * e1
            x = weight * e2
            w[GRAM + 24 + i] += x * e0
            w[GRAM + 32 + i] += x * e1
            w[GRAM + 40 + i] += x * e2
            x = weight * e3
            w[GRAM + 48 + i] += x * e0
            w[GRAM + 56 + i] += x * e1
            w[GRAM + 64 + i] += x * e2
            w[GRAM + 72 + i] += x * e3
            x = weight * e4
            w[GRAM + 80 + i] += x * e0
            w[GRAM + 88 + i] += x * e1
            w[GRAM + 96 + i] += x * e2
            w[GRAM + 104 + i] += x * e3
            w[GRAM + 112 + i] += x * e4
            x = weight * e5
            w[GRAM + 120 + i] += x * e0
            w[GRAM + 128 + i] += x * e1
            w[GRAM + 136 + i] += x * e2
            w[GRAM + 144 + i] += x * e3
            w[GRAM + 152 + i] += x * e4
            w[GRAM + 160 + i] += x * e5
            x = weight * e6
            w[GRAM + 168 + i] += x * e0
            w[GRAM + 176 + i] += x * e1
            w[GRAM + 184 + i] += x * e2
            w[GRAM + 192 + i] += x * e3
            w[GRAM + 200 + i] += x * e4
            w[GRAM + 208 + i] += x * e5
            w[GRAM + 216 + i] += x * e6
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
