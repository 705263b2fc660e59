# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Take out of the delays what the time between logger and controller does to them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.features import TIMED, USUAL_PERIODS_S
from valve_twin.core.diagnosis.watch.growing import Growing, begins
from valve_twin.core.estimation.data.robust import MAD_SCALE as _MAD
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.types import BoolArray, FloatArray, IntArray

_RECENT = 8
SLIP = (0.6, 1.5)
"""Jumps of a delay that a sample more or less can make, assumed [samples]."""

_MOST_SLIPS = 2
"""Slips in `_RECENT` cycles above which a delay scatters, assumed."""

_UNMOVED = 0.1
"""Share of such a jump by which the other delay may move [1]."""

_SHOWN = 3.0
"""Scatters of the cycles before by which a jump behind a pause shows [1]."""

_LEAST = 1.0 / 30.0
"""Least jump of a delay that a pause explains, assumed [samples]."""


class Slips:
    """Takes out of the delays what the time between logger and controller does to them.

    Where controller and logger are not in step, a command is logged a sample earlier or later
    from some cycle on. One delay then jumps by a sample, and nothing else. A delay that jumps more
    often scatters so: nothing is taken out. Where the two are in step, each cycle lies alike
    between the samples, until a pause shifts all that follow by a part of a sample.
    """

    def __init__(self) -> None:
        self._given, self._out = np.empty((0, 0)), Growing(0)
        self._paused, self._period_s = np.zeros(0, dtype=np.bool_), np.empty(0)
        self._table: SignatureTable | None = None

    def taken_out(
        self,
        vectors: FloatArray,
        table: SignatureTable,
        paused: BoolArray | None = None,
        period_s: FloatArray | None = None,
    ) -> FloatArray:
        """Return features whose delays do not jump alone; those of before are not gone through.

        Parameters
        ----------
        vectors : (N, F) array
            Features [unit by feature].
        table : SignatureTable
            Names of the features.
        paused : (N,) bool array, optional
            Whether a pause lies between a cycle and the one before of its product.
        period_s : (N,) array, optional
            Time between the samples of a cycle [s]; NaN where it does not tell it.
        """
        if not set(TIMED) <= set(table.features):
            return vectors
        paused = np.zeros(len(vectors), dtype=np.bool_) if paused is None else paused
        period_s = np.full(len(vectors), np.nan) if period_s is None else period_s
        same = self._table is table and begins(self._given, vectors)
        same = same and begins(self._paused, paused)
        if not same or not begins(self._period_s, period_s):
            width = len(TIMED)
            self._table, self._out = table, Growing(vectors.shape[1])
            self._timed, self._shift = Growing(width), np.zeros(width)
            self._due = np.zeros(width, dtype=np.bool_)
            self._slips = np.full((2, _MOST_SLIPS), -_RECENT - 1)  # the last rows that slipped
        columns = [table.features.index(n) for n in TIMED]
        count = len(self._out)
        self._timed.put(count, vectors[count:, columns])
        take_out_slips(
            self._timed.rows, paused, period_s, self._shift, self._slips, self._due, count
        )
        self._out.put(count, vectors[count:])
        self._out.rows[count:, columns] = self._timed.rows[count:]
        self._given, self._paused, self._period_s = vectors, paused, period_s
        return self._out.rows


@njit(cache=True)
def take_out_slips(
    timed: FloatArray,
    paused: BoolArray,
    period_s: FloatArray,
    shift: FloatArray,
    slips: IntArray,
    due: BoolArray,
    first: int,
) -> None:
    """Take jumps of one of two delays alone, and those behind a pause, out of `TIMED`, in place.

    Parameters
    ----------
    timed : (N, 3) array
        Both delays [s], and the shortfall, which goes with them [as followed]; NaN where a cycle
        does not show one.
    paused : (N,) bool array
        Whether a pause lies between a cycle and the one before.
    period_s : (N,) array
        Time between the samples of a cycle [s]; NaN where it does not tell it.
    shift : (3,) array
        What was taken out of the last row before [as these]; is kept up.
    slips : (2, K) int64 array
        Last rows in which each slipped; is kept up.
    due : (3,) bool array
        Of which no value was seen since the last pause; is kept up.
    first : int
        First row that is gone through.
    """
    usual, scatter, known = np.empty(3), np.empty(3), np.empty(_RECENT)
    for row in range(max(first, 1), len(timed)):
        for i in range(3):
            count = 0
            for k in range(max(row - _RECENT, 0), row):
                if np.isfinite(timed[k, i]):
                    known[count] = timed[k, i]
                    count += 1
            usual[i] = np.median(known[:count]) if count else np.nan
            off = np.abs(known[:count] - usual[i])
            scatter[i] = _MAD * np.median(off) if count else np.nan
        shortest, longest = USUAL_PERIODS_S
        if np.isfinite(period_s[row]):
            shortest = longest = period_s[row]
        least, most = SLIP[0] * shortest, SLIP[1] * longest
        if paused[row]:
            due[:] = True
        off = timed[row] - shift - usual
        jumped = False
        for i in range(3):
            if not due[i] or np.isnan(off[i]):
                continue
            due[i] = False
            far = abs(off[i])
            if i < 2:
                jumps = max(_SHOWN * scatter[i], _LEAST * longest) < far < most
                jumped = jumped or jumps
            else:
                jumps = jumped and far > _SHOWN * scatter[i]
            if jumps:
                shift[i] += off[i]
                off[i] = 0.0
        for i in range(2):
            alone, other = off[i], off[1 - i]
            if np.isnan(other):
                other = 0.0
            often = row - slips[i, 0] < _RECENT
            jumps = least < abs(alone) < most and not often
            if jumps and abs(other) < _UNMOVED * abs(alone):
                shift[i] += alone
                slips[i, :-1] = slips[i, 1:]
                slips[i, -1] = row
        timed[row] -= shift


def warm_up() -> None:
    """Compile the kernel."""
    two, no = np.zeros((2, 3)), np.zeros(3, dtype=np.bool_)
    slips = np.zeros((2, 2), dtype=np.int64)
    take_out_slips(two, no[:2], np.ones(2), np.zeros(3), slips, no.copy(), 0)
