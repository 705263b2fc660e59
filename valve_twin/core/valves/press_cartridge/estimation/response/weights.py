# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What weighs the samples of a cycle, whatever pole and delay: once for all free runs of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import ByteArray, FloatArray, IntArray
    from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import Rows

MOTION, HOLD, REST = 0, 1, 2
"""A command acts or has just acted; none does; nothing moves."""

_FREE, _USE, _MOVING = 1, 2, 4
_OFTEN = 8  # samples until a product of weights becomes a logarithm


class Weighed(NamedTuple):
    """N samples as `run_lanes` takes them.

    A gap is what a response is off its level. Where all speeds are zero, but that of the leak, -1
    in a hold, the gaps e at a sample, of which l is the leak's, add to the end of its stretch
    a e_j e_k to the normal equations, with the leak's (a l + b) e_k and a l^2 + 2 b l + d, with
    the position's c e_k and c l + f; and they become g e and g l + h there.

    Attributes
    ----------
    v_in, v_out : (N,) arrays
        Commands without delay [1].
    kind : (N,) uint8 array
        MOTION, HOLD or REST.
    end : (N,) int64 array
        First sample behind the stretch of samples of one kind.
    weight, gain : (N,) arrays
        Of the sample in the normal equations, and share of a gap that it takes into the level;
        zero where it is not used, a gain of 1 where the level begins anew [1].
    off : (N,) array
        By how much the position is off its level [1].
    tail : (N, 7) array
        a, b, d, c, f, g and h of the sample; nothing in motion.
    squares, log_determinant : float
        Weighted squares of the position, log determinant of the weights [1].
    rows : int
        Samples that count.
    """

    v_in: FloatArray
    v_out: FloatArray
    kind: ByteArray
    end: IntArray
    weight: FloatArray
    gain: FloatArray
    off: FloatArray
    tail: FloatArray
    squares: float
    log_determinant: float
    rows: int


@njit(cache=True, error_model="numpy")
def weigh_rows(rows: Rows, wander: float, latest: float) -> Weighed:
    """Return what weighs the samples.

    Parameters
    ----------
    rows : Rows
        N samples, commands without delay.
    wander : float
        Random walk, see `accumulate` [1].
    latest : float
        The longest delay that will be asked for [samples].
    """
    size, reach = len(rows.y), int(latest) + 1
    kind = np.empty(size, dtype=np.uint8)
    weight, gain, off = np.zeros(size), np.zeros(size), np.zeros(size)
    variance = -1.0  # of the level, in units of the noise; negative = unknown
    place = 0.0  # of the measurement
    squares = 0.0
    product = 1.0  # of the weights
    log_determinant = 0.0
    count = 0
    driven = 0  # the last sample with a command
    for n in range(size):
        flag, anchor = rows.flags[n], rows.anchor[n]
        if anchor > 0.0:
            known_still = variance >= 0.0 and anchor < np.inf
            variance = variance + anchor if known_still else -1.0
        driven = n if rows.v_in[n] > 0.0 or rows.v_out[n] > 0.0 else driven
        kind[n] = (HOLD if n - driven > reach else MOTION) if flag & _FREE else REST
        if flag & _FREE and flag & _MOVING:
            variance += wander if variance >= 0.0 else 0.0
        if not flag & _USE:
            continue
        if variance < 0.0:
            place, variance, gain[n] = rows.y[n], 1.0, 1.0
            continue
        weight[n] = 1.0 / (1.0 + variance)
        variance = gain[n] = variance * weight[n]
        product *= weight[n]
        count += 1
        if count % _OFTEN == 0:
            log_determinant -= np.log(product)
            product = 1.0
        off[n] = rows.y[n] - place
        place += gain[n] * off[n]
        squares += weight[n] * off[n] * off[n]
    end, tail = np.empty(size, dtype=np.int64), np.zeros((size, 7))
    _fill_tails(kind, weight, gain, off, end, tail)
    log_determinant -= np.log(product)
    return Weighed(
        rows.v_in,
        rows.v_out,
        kind,
        end,
        weight,
        gain,
        off,
        tail,
        squares,
        log_determinant,
        count,
    )


@njit(cache=True)
def _fill_tails(
    kind: ByteArray,
    weight: FloatArray,
    gain: FloatArray,
    off: FloatArray,
    end: IntArray,
    tail: FloatArray,
) -> None:
    """Fill the ends of the stretches, and what is left of them, from the last sample back."""
    a = b = d = c = f = h = 0.0
    g = 1.0
    for n in range(len(kind) - 1, -1, -1):
        if n + 1 == len(kind) or kind[n + 1] != kind[n]:
            end[n] = n + 1
            a = b = d = c = f = h = 0.0
            g = 1.0
        else:
            end[n] = end[n + 1]
        if kind[n] == MOTION:
            continue
        kept = 1.0 - gain[n]
        b *= kept
        a = weight[n] + kept * kept * a
        c = weight[n] * off[n] + kept * c
        g *= kept
        if kind[n] == HOLD:  # the leak moves by a sample first
            d += a - 2.0 * b
            b -= a
            f -= c
            h -= g
        tail[n, 0], tail[n, 1], tail[n, 2], tail[n, 3] = a, b, d, c
        tail[n, 4], tail[n, 5], tail[n, 6] = f, g, h
