# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What can be read in two ways in a CSV file: quotes, commas, the hour in which clocks change."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.io.errors import BagError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from valve_twin.core.types import FloatArray, IntArray

_GROUPED = re.compile(r"[-+]?[1-9]\d{0,2},\d{3}", re.ASCII)
_WHOLE = re.compile(r"[-+]?\d+", re.ASCII)
_HOUR_S = 3600.0
_KNOWN_S = 6e10
"""Times that a calendar of four digits knows, from 1970 on [s]."""

_CHANGES = {3, 4, 9, 10, 11}
"""Months in which clocks are put forward or back somewhere."""

_SUNDAY = 6
_EARLY = 4


@dataclass(slots=True)
class _Seen:
    """Numbers of a column: the first with a comma and its line, one with a point, a whole one."""

    comma: tuple[int, str] | None = None
    point: str = ""
    whole: str = ""
    grouped: bool = True

    def take(self, number: int, cell: str) -> None:
        if "," in cell:
            self.comma = self.comma or (number, cell)
            self.grouped = self.grouped and _GROUPED.fullmatch(cell) is not None
        elif "." in cell:
            self.point = cell
        elif _WHOLE.fullmatch(cell):
            self.whole = cell


def check_quotes(path: Path, rows: Sequence[tuple[int, str]], separator: str) -> None:
    """Refuse a line whose quote is not closed: it would swallow what follows.

    A quote inside a cell, such as a sign of inches, opens nothing.

    Parameters
    ----------
    path : path
        The file.
    rows : sequence of (int, str)
        Numbers and texts of its lines.
    separator : str
        Of its cells.

    Raises
    ------
    BagError
        Names the line.
    """
    for number, line in rows:
        if '"' not in line or not line.count('"') % 2:
            continue
        try:
            next(csv.reader([line], delimiter=separator, strict=True))
        except csv.Error:
            msg = f"{path}:{number}: a quote is opened and not closed in this line; correct it"
            raise BagError(msg) from None


def check_commas(
    path: Path, rows: Sequence[tuple[int, str]], separator: str, columns: Sequence[tuple[int, str]]
) -> None:
    """Refuse a column whose commas may stand before decimals or between thousands.

    Parameters
    ----------
    path : path
        The file.
    rows : sequence of (int, str)
        Numbers and texts of its lines.
    separator : str
        Of its cells.
    columns : sequence of (int, str)
        Place and name of what is read.

    Raises
    ------
    BagError
        Names the line, the column and both readings.
    """
    if separator == "," or not any("," in line for _, line in rows):
        return
    seen = [_Seen() for _ in columns]
    for number, line in rows:
        quoted = '"' in line
        cells = next(csv.reader([line], delimiter=separator)) if quoted else line.split(separator)
        for (index, _), column in zip(columns, seen, strict=True):
            if index < len(cells):
                column.take(number, cells[index].strip())
    for (_, name), column in zip(columns, seen, strict=True):
        other = column.point or (column.whole if column.grouped else "")
        if column.comma is not None and other:
            msg = (
                f"{path}:{column.comma[0]}: column '{name}': '{column.comma[1]}' beside "
                f"'{other}': the comma may stand before decimals or between thousands; export the "
                "numbers with a decimal point and nothing between thousands"
            )
            raise BagError(msg)


def check_widths(path: Path, rows: Sequence[tuple[int, str]], separator: str, width: int) -> None:
    """Refuse a row whose values go on beyond the cells of the first line.

    Parameters
    ----------
    path : path
        The file, for messages.
    rows : sequence of (int, str)
        Number and text of every line.
    separator : str
        Between cells.
    width : int
        Cells of the first line.
    """
    for number, line in rows:
        if line.count(separator) < width:
            continue
        cells = next(csv.reader([line], delimiter=separator))
        if any(cell.strip() for cell in cells[width:]):
            msg = (
                f"{path}:{number}: the row has {len(cells)} cells, the first line has {width}: "
                "a decimal comma, or a column without name? Correct the row or the first line"
            )
            raise BagError(msg)


def clock_notices(path: Path, lines: IntArray, seconds: FloatArray) -> tuple[str, ...]:
    """Return where a clock without zone seems to be put forward.

    Parameters
    ----------
    path : path
        The file.
    lines : (N,) int64 array
        Line of every row.
    seconds : (N,) array
        Times as they stand, taken for UTC [s].
    """
    steps = np.diff(seconds)
    if not len(steps):
        return ()
    usual = float(np.nanmedian(steps))
    known = np.abs(seconds[:-1]) < _KNOWN_S
    skips = (steps >= _HOUR_S) & (steps <= _HOUR_S + 3.0 * usual)
    found = np.flatnonzero(skips & known & (usual < 900.0))
    told = []
    for at in found.tolist():
        before = datetime.fromtimestamp(float(seconds[at]), tz=timezone.utc)
        if before.weekday() == _SUNDAY and before.month in _CHANGES and before.hour < _EARLY:
            told.append(
                f"{path}:{int(lines[at + 1])}: the clock skips the hour after "
                f"{before:%Y-%m-%d %H:%M} and names no zone: it was put forward, not the plant "
                "stopped? Export the time in UTC or with its offset (+01:00)"
            )
    return tuple(told)
