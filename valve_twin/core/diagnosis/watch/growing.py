# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Rows that grow, and whether some are the first of others."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from valve_twin.core.types import FloatArray, IntArray

_FIRST = 64  # rows that there is room for at least


class Growing:
    """(N, F) rows in one array that has room for more.

    Parameters
    ----------
    width : int
        F.
    rows : (N, F) array, optional
        The first ones.
    """

    def __init__(self, width: int, rows: FloatArray | None = None) -> None:
        self._room, self._size = np.empty((0, width)), 0
        if rows is not None:
            self.put(0, rows)

    def __len__(self) -> int:
        """Return N."""
        return self._size

    @property
    def rows(self) -> FloatArray:
        """What is there now, (N, F); only what is put again changes in it."""
        return self._room[: self._size]

    def put(self, first: int, rows: FloatArray) -> None:
        """Let some rows stand from row `first` on, behind which there are none then."""
        size = first + len(rows)
        if size > len(self._room):
            most = _FIRST if len(rows) < _FIRST else len(rows)
            wider = np.empty((max(2 * len(self._room), first + most), self._room.shape[1]))
            wider[:first] = self._room[:first]
            self._room = wider
        self._room[first:size] = rows
        self._size = size

    def add_up(self, first: int, rows: FloatArray) -> None:
        """Let row `first` + k + 1 be row `first` and the first k + 1 rows, added one by one."""
        together = np.concatenate((self._room[first : first + 1], rows))
        self.put(first, np.cumsum(together, axis=0))


def begins(known: NDArray[Any], now: NDArray[Any]) -> bool:
    """Return whether an array is the first rows of another, bit by bit.

    Parameters
    ----------
    known, now : (N, ...), (M, ...) arrays
        Of one type, each row without gaps.
    """
    count = len(known)
    if count > len(now) or known.dtype != now.dtype or known.shape[1:] != now.shape[1:]:
        return False
    if known.base is not None and known.base is now.base and _at(known) == _at(now):
        return True  # the same rows themselves, of which more are known now
    first = now[:count]
    if known.dtype == np.float64:  # what is no number equals itself
        return bool(np.array_equal(known.view(np.int64), first.view(np.int64)))
    return bool(np.array_equal(known, first))


def _at(rows: NDArray[Any]) -> tuple[int, tuple[int, ...]]:
    """Return where the first of some rows lies in memory, and how far the others are apart."""
    return rows.__array_interface__["data"][0], rows.strides


def present(number: IntArray) -> list[int]:
    """Return which numbers from 0 on occur among some, (N,), rising."""
    found: list[int] = np.flatnonzero(np.bincount(number[number >= 0])).tolist()
    return found
