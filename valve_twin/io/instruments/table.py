# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What every reader returns: columns with names, units and times of their own."""

from __future__ import annotations

import importlib
import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from valve_twin.io.errors import BagError
from valve_twin.io.limits import too_large
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from valve_twin.core.types import BoolArray, FloatArray, IntArray

MOST_COLUMNS = 2000
"""More columns than that are no channels of an instrument."""

_FEW = 100  # of so many rows one at an end may be set apart
_MOST_APART = 5  # rows at an end that may be set apart
_PAUSE = 10.0  # pause that sets them apart, in times of all the others


@dataclass(frozen=True, slots=True)
class Column:
    """One channel.

    Attributes
    ----------
    name, unit : str
        As they stand in the file; the name is unique in it.
    seconds : (N,) array
        Time of every value since the recording's start [s]; it rises.
    values : (N,) array
        NaN = no value [unit].
    """

    name: str
    unit: str
    seconds: FloatArray
    values: FloatArray


@dataclass(frozen=True, slots=True)
class Recording:
    """What a file holds.

    Attributes
    ----------
    path : Path
        The file.
    columns : tuple of Column
        Its numeric channels without the one that carries the time.
    clock : str
        Where the times come from, in words.
    measured : bool
        Whether the file states them; False = rows were counted or the unit was assumed.
    start_ns : int or None
        Date of the first row, nanoseconds since 1970; None = the file has no date.
    notices : tuple of str
        What was left out or looks wrong, one line each.
    time_column : str
        The column that carried the time; empty = none did, or every channel has its own.
    time_scale : float
        Seconds in one unit of it [s].
    """

    path: Path
    columns: tuple[Column, ...]
    clock: str
    measured: bool
    start_ns: int | None = None
    notices: tuple[str, ...] = ()
    time_column: str = ""
    time_scale: float = 1.0


def unique(columns: Iterable[Column]) -> tuple[Column, ...]:
    """Return columns whose names are unique: the second "p" is "p_2"."""
    taken: set[str] = set()
    made = []
    for column in columns:
        name = unique_name(column.name, taken)
        taken.add(name)
        made.append(replace(column, name=name))
    return tuple(made)


def unique_name(name: str, taken: Iterable[str]) -> str:
    """Return a name, with a number behind it where it is taken already."""
    known, number, found = set(taken), 1, name
    while found in known:
        number += 1
        found = f"{name}_{number}"
    return found


def topic_name(column: str) -> str:
    """Return the part of a topic that stands for a column: letters, digits and _ only."""
    plain = re.sub(r"[^A-Za-z0-9]+", "_", column).strip("_").lower()
    return plain if plain[:1].isalpha() else f"c_{plain}".rstrip("_")


def load_package(name: str, path: Path) -> Any:  # noqa: ANN401  a module without types
    """Import a package of the extra `files`.

    Raises
    ------
    BagError
        If it is not installed; names the command that installs it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as err:
        package = name.partition(".")[0]
        msg = (
            f"{path}: is read with the package {package}: pip install 'valve_twin[files]' ({err})"
        )
        raise BagError(msg) from err


def check_size(path: Path, size: int) -> None:
    """Refuse what unpacks to more than a foreign file may.

    Parameters
    ----------
    path : Path
        The file.
    size : int
        Bytes that will lie in memory, as the file claims.

    Raises
    ------
    BagError
        Names the limit.
    """
    problem = too_large(size, path.stat().st_size)
    if problem:
        msg = f"{path}: {problem}"
        raise BagError(msg)


def check_count(path: Path, count: int) -> None:
    """Refuse a file of no channel, or of more than an instrument has.

    Parameters
    ----------
    path : Path
        The file.
    count : int
        Channels of numbers.

    Raises
    ------
    BagError
        Names the limit.
    """
    if not 0 < count <= MOST_COLUMNS:
        msg = f"{path}: holds {count} channels of numbers, 1 to {MOST_COLUMNS} are read"
        raise BagError(msg)


def rising(seconds: FloatArray) -> BoolArray:
    """Return which times can be those of one clock: (N,) bool.

    The most rows that rise strictly: an outlier is left out by itself, whether it lies before or
    behind its neighbours. So are the first or last rows (one in a hundred, five at most) where a
    pause of more than ten times all the others' time sets them apart.

    Parameters
    ----------
    seconds : (N,) array
        Times in the order of their rows; NaN is none [s].
    """
    keep = np.isfinite(seconds)
    at = np.flatnonzero(keep)
    times = np.asarray(seconds, dtype=np.float64)[at]
    if len(times) and not (np.diff(times) > 0.0).all():
        at = at[_longest_rise(times)]
        keep[:] = False
        keep[at] = True
    times = seconds[at]
    for apart in range(min(len(at) // _FEW, _MOST_APART), 0, -1):
        first, last = times[apart] - times[apart - 1], times[-apart] - times[-apart - 1]
        if first > _PAUSE * (times[-1] - times[apart]):
            keep[at[:apart]] = False
        if last > _PAUSE * (times[-apart - 1] - times[0]):
            keep[at[-apart:]] = False
    return keep


def wild_row(seconds: FloatArray, keep: BoolArray) -> str:
    """Say of the first row that `rising` left out what its time is, and how many there are.

    Parameters
    ----------
    seconds : (N,) array
        Times [s].
    keep : (N,) bool array
        What `rising` returned of them, not all of it true.
    """
    bad, count = int(np.argmin(keep)), int(np.count_nonzero(~keep))
    before, behind = seconds[:bad][keep[:bad]], seconds[bad:][keep[bad:]]
    where = [f"behind {before[-1]:.15g}"] if len(before) else []
    where += [f"before {behind[0]:.15g}"] if len(behind) else []
    rows = "1 such row is" if count == 1 else f"{count} such rows are"
    return f"{seconds[bad]:.15g} stands {' and '.join(where)}; {rows} left out"


@njit(cache=True)
def _longest_rise(times: FloatArray) -> IntArray:
    """Return the rows of a longest strictly rising part, of equal times the first."""
    n = len(times)
    ends = np.empty(n, dtype=np.int64)  # by length - 1: the row with the least time that ends one
    before = np.empty(n, dtype=np.int64)
    length = 0
    for i in range(n):
        low, high = 0, length
        while low < high:
            mid = (low + high) // 2
            if times[ends[mid]] < times[i]:
                low = mid + 1
            else:
                high = mid
        before[i] = ends[low - 1] if low else -1
        if low == length or times[i] < times[ends[low]]:
            ends[low] = i
        length = max(length, low + 1)
    found = np.empty(length, dtype=np.int64)
    row = ends[length - 1] if length else -1
    for k in range(length - 1, -1, -1):
        found[k] = row
        row = before[row]
    return found
