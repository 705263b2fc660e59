# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The free run of eight poles and delays at once, with its sensitivities to both.

As `output_error_kernel.accumulate`, whose equations hold here, but each sample goes into eight
runs, one a lane of the machine's vectors. What weighs a sample is the same in all of them and is
computed once, see `weights`; where nothing moves any more the rest of a hold is one step.

No operation joins two lanes but the question whether all have come to rest: the bits of one
depend on the others by less than `still`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.core.valves.press_cartridge.estimation.response.weights import HOLD, MOTION
from valve_twin.core.valves.press_cartridge.estimation.solvers.lanes import (
    LANES,
    add_squares,
    follow,
    weigh,
)
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.press_cartridge.estimation.response.weights import Weighed

# first element of each block of `LANES` in the work array
_SPEED, _GAP = 0, 64  # five parameters, pole, delay; speed of the model behind them
GRAM = 120
"""Lower triangle of the (8, 8) normal equations, row by row: parameters, pole, delay, position."""

# what is asked, and the commands of a sample
POLE, DELAY, AT = 408, 416, 424
_IN, _OUT, _BY_IN, _BY_OUT = 464, 472, 480, 488
SIZE = 496
"""Length of the work array."""

STILL = 1e-14
"""Speed of a response to commands up to 1 that moves nothing any more [1]."""

_LATE = 6  # row of the delay in the normal equations
_OFTEN = 8  # samples of a hold until its speeds are looked at


@njit(cache=True, error_model="numpy")
def run_lanes(data: Weighed, v_max: float, still: float, w: FloatArray) -> None:
    """Write the normal equations of eight free runs.

    Parameters
    ----------
    data : Weighed
        N samples, commands without delay.
    v_max : float
        Greatest command [1].
    still : float
        Speeds of responses below which a hold is taken for rest [1].
    w : (SIZE,) array
        Poles at `POLE` [1], delays at `DELAY` [samples], five parameters at `AT` [1]; the rest is
        overwritten.
    """
    for i in range(POLE):
        w[i] = 0.0
    n, held = 0, 0
    while n < len(data.gain):
        if data.kind[n] == HOLD:
            if held % _OFTEN == 0 and _largest(w) <= still:
                _rest(data, n, w)
                for i in range(LANES):  # where the speeds have come to
                    w[_SPEED + 32 + i] = -1.0
                    w[_SPEED + 56 + i] = -w[AT + 32 + i]
                n, held = data.end[n], 0
                continue
            held += 1
            _hold(w)
        elif data.kind[n] == MOTION:
            held = 0
            _move(data, n, v_max, w)
        else:
            _rest(data, n, w)
            n, held = data.end[n], 0
            continue
        if data.gain[n] > 0.0:
            _correct(data.weight[n], data.gain[n], data.off[n], w)
        n += 1
    for i in range(LANES):
        w[GRAM + 280 + i] = data.squares


@njit(cache=True, inline="always")
def _largest(w: FloatArray) -> float:
    """Return the largest speed, those of leak and model taken from where they come to."""
    most = 0.0
    for i in range(LANES):
        leak, model = w[_SPEED + 32 + i] + 1.0, w[_SPEED + 56 + i] + w[AT + 32 + i]
        most = max(most, abs(leak), abs(model))
    for i in range(4 * LANES):
        most = max(most, abs(w[_SPEED + i]))
    for i in range(40, 56):
        most = max(most, abs(w[_SPEED + i]))
    return most


@njit(cache=True, inline="always")
def _hold(w: FloatArray) -> None:
    """Move the runs by a sample without commands."""
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


@njit(cache=True, inline="always")
def _move(data: Weighed, n: int, v_max: float, w: FloatArray) -> None:
    """Move the runs by a sample with commands."""
    for i in range(LANES):
        late = int(w[DELAY + i])
        part = w[DELAY + i] - late
        newer, older = max(n - late, 0), max(n - late - 1, 0)
        w[_IN + i] = (1.0 - part) * data.v_in[newer] + part * data.v_in[older]
        w[_OUT + i] = (1.0 - part) * data.v_out[newer] + part * data.v_out[older]
        w[_BY_IN + i] = data.v_in[older] - data.v_in[newer]
        w[_BY_OUT + i] = data.v_out[older] - data.v_out[newer]
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


@njit(cache=True, inline="always")
def _correct(weight: float, gain: float, off: float, w: FloatArray) -> None:
    """Add a sample to the normal equations, and take it into the levels."""
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


@njit(cache=True)
def _rest(data: Weighed, n: int, w: FloatArray) -> None:
    """Add all from a sample to the end of its stretch, in which only the leak moves, if it acts.

    What it does to the normal equations is quadratic in the gaps at its begin, see `Weighed`.
    """
    squares, by_leak, leak_squares, off, off_by_leak, kept, moved = data.tail[n]
    for i in range(LANES):
        e0 = w[_GAP + i]
        e1 = w[_GAP + 8 + i]
        e2 = w[_GAP + 16 + i]
        e3 = w[_GAP + 24 + i]
        e4 = w[_GAP + 32 + i]
        e5 = w[_GAP + 40 + i]
        e6 = w[_GAP + 48 + i]
        add_squares(w, GRAM + i, squares, e0, e1, e2, e3, e4, e5, e6)
        w[GRAM + 80 + i] += by_leak * e0
        w[GRAM + 88 + i] += by_leak * e1
        w[GRAM + 96 + i] += by_leak * e2
        w[GRAM + 104 + i] += by_leak * e3
        w[GRAM + 112 + i] += 2.0 * by_leak * e4 + leak_squares
        w[GRAM + 152 + i] += by_leak * e5
        w[GRAM + 200 + i] += by_leak * e6
        w[GRAM + 224 + i] += off * e0
        w[GRAM + 232 + i] += off * e1
        w[GRAM + 240 + i] += off * e2
        w[GRAM + 248 + i] += off * e3
        w[GRAM + 256 + i] += off * e4 + off_by_leak
        w[GRAM + 264 + i] += off * e5
        w[GRAM + 272 + i] += off * e6
        w[_GAP + i] = kept * e0
        w[_GAP + 8 + i] = kept * e1
        w[_GAP + 16 + i] = kept * e2
        w[_GAP + 24 + i] = kept * e3
        w[_GAP + 32 + i] = kept * e4 + moved
        w[_GAP + 40 + i] = kept * e5
        w[_GAP + 48 + i] = kept * e6
    for i in range(_GAP):
        w[_SPEED + i] = 0.0


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
