# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Follow a gain at one command, and there where its cycles tell it best.

A gain that falls with the command is published with its fall (first in `Parameter.fall`). Both are
found from the same samples: what a cycle mistakes for the one it takes from the other. With z =
fall/gain, which wear that scales a gain leaves as it is, the gain at a command farther by d is
gain (1 + z d).

1. A gain that is published at the mean command of its cycle (second in `fall`) is brought to
   that of the reference cycles: the controller works elsewhere as the valve ages.
2. It is followed at the command at which it scatters least, and carried back by the usual z. How
   far that is follows from how the values go with z beside a smooth trend: gain - share (z - usual
   z). Where the fall itself ages, it is the gain at that command that is followed.

Both rest on the first `MOST` values, so that older values stay what they were.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.cutting.memory import Memory
from valve_twin.core.estimation.data.robust import robust_sigma

if TYPE_CHECKING:
    from valve_twin.core.aging.series import Series
    from valve_twin.core.past.columns import Rows
    from valve_twin.core.types import FloatArray, IntArray, Parameter

FEWEST = 12
"""Fewest values by which the command is found [1], assumed."""

MOST = 500
"""Values, the first ones, by which it is found [1]."""

_FARTHEST = 1.0  # of that command from the published one: commands run from 0 to 1
_POWERS = 3  # of the smooth trend
_ROUNDS = 3
_FAR = 4.0  # robust standard deviations beyond which a value does not count


def at_one_command(
    series: Series,
    rows: Rows,
    parameter: Parameter,
    numbers: IntArray,
    *,
    first: int,
    memory: Memory | None = None,
) -> Series:
    """Bring the values of a gain to one command, and take out what goes with their fall.

    Parameters
    ----------
    series : Series
        Accepted values of the parameter.
    rows : Rows
        The estimates of the trend, refused ones included.
    parameter : Parameter
        What it is; nothing is done where no fall is published with it.
    numbers : (M,) int64 array
        The product of every row, see `products.product_numbers`.
    first : int
        Values whose median command is that of the reference [1].
    memory : Memory, optional
        What was found before: saves time and changes nothing.

    Returns
    -------
    Series
        As it would be; values of cycles without a fall are brought to the command alone.
    """
    n = len(series.values)
    if not parameter.fall or n < FEWEST or not np.all(series.values > 0.0):
        return series
    place = series.rows_in(rows)
    y, z = series.values, rows.value(parameter.fall[0])[place] / series.values
    known = np.isfinite(z[:MOST])
    if np.count_nonzero(known) < FEWEST:
        return series
    usual = float(np.median(z[:MOST][known]))
    z = np.where(np.isfinite(z), z - usual, 0.0)
    for command in parameter.fall[1:]:
        y = y * (1.0 + usual * _farther(rows.value(command)[place], first))
    head = slice(min(n, MOST))
    if not np.any(z[head]):
        return replace(series, values=y)
    parts = (series.axis[head], y[head], z[head], numbers[place[head]].astype(np.float64))
    share = (memory or Memory()).of("fall", parts, lambda: _share(*parts))
    return replace(series, values=y - share * z)


def _farther(command: FloatArray, first: int) -> FloatArray:
    """Return how far that of the reference is from (N,) commands, 0 where unknown [1]."""
    own = command[:first][np.isfinite(command[:first])]
    if not len(own):
        return np.zeros(len(command))
    return np.where(np.isfinite(command), np.median(own) - command, 0.0)


def _share(x: FloatArray, y: FloatArray, z: FloatArray, number: FloatArray) -> float:
    """Return by how much values go with z beside a smooth trend and products [unit]."""
    u = (x - x[0]) / (x[-1] - x[0]) - 0.5
    others = [number == k for k in np.unique(number)[1:]]
    columns = np.column_stack([z, *(u**k for k in range(_POWERS + 1)), *others])
    good = np.ones(len(y), np.bool_)
    found = np.zeros(columns.shape[1])
    for _ in range(_ROUNDS):
        scale = np.maximum(np.sqrt(np.sum(columns[good] ** 2, axis=0)), 1e-300)
        found = np.linalg.lstsq(columns[good] / scale, y[good], rcond=1e-9)[0] / scale
        off = y - columns @ found
        good = np.abs(off) <= _FAR * robust_sigma(off) + 1e-300
    most = _FARTHEST * float(np.median(y))
    return float(np.clip(found[0], -most, most))
