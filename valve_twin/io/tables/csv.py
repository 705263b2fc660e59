# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read columns of numbers from CSV files of loggers and plant historians.

Separator, header, byte-order mark, gzip, decimal commas and the encoding are found from the file;
whatever cannot be a number is named with its line.
"""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.quantity import suggest
from valve_twin.io.errors import BagError
from valve_twin.io.instruments.text.encoding import decode, unpacked
from valve_twin.io.tables.csv_doubts import (
    check_commas,
    check_quotes,
    check_widths,
    clock_notices,
)

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from valve_twin.core.types import FloatArray, IntArray

_SEPARATORS = ";\t,|"
_NO_VALUE = {"", "nan", "null", "none", "n/a", "na", "-", "bad", "#n/a"}
_NUMBER = re.compile(
    r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?inf(inity)?", re.ASCII | re.IGNORECASE
)
"""What is a number in a table; Python alone would take 1_000 for one, too."""

_PROBE_LINES = 20
_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)


@dataclass(frozen=True, slots=True)
class Table:
    """Columns of a file.

    Attributes
    ----------
    path : Path
        The file.
    lines : (N,) int64 array
        Line of every row in the file, counted from 1.
    columns : list of (N,) arrays
        In the order they were asked for; NaN = no value.
    dated : bool
        Whether the first column held dates; its unit is then the second since 1970.
    notices : tuple of str
        What looks wrong but could be so.
    """

    path: Path
    lines: IntArray
    columns: list[FloatArray]
    dated: bool = False
    notices: tuple[str, ...] = ()


def read_table(
    path: Path, names: Sequence[str], *, separator: str = "", dates: bool = False
) -> Table:
    """Read some columns of a file.

    Parameters
    ----------
    path : path
        CSV file, plain or gzip.
    names : sequence of str
        Column names of the header, or numbers counted from 0.
    separator : str
        One character; empty = found from the first lines.
    dates : bool
        Whether the first column asked for may hold dates (ISO 8601) instead of numbers.

    Returns
    -------
    Table
        With at least one row.

    Raises
    ------
    BagError
        If the file is no CSV file, a column is missing, or a cell is no number; names the file,
        line and column.
    """
    text = _read_text(path)
    numbered = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip()]
    if not numbered:
        msg = f"{path}: is empty; give a CSV file with rows"
        raise BagError(msg)
    mark = separator or _find_separator([line for _, line in numbered[:_PROBE_LINES]])
    check_quotes(path, numbered, mark)
    first = _cells(path, numbered[0][1], mark)
    header = [] if all(_is_value(cell, mark) for cell in first) else [c.strip() for c in first]
    rows = numbered[1:] if header else numbered
    if not rows:
        msg = f"{path}: has a header but no rows; export the data with it"
        raise BagError(msg)
    indexes = [_index(path, name, header, len(first)) for name in names]
    check_widths(path, rows, mark, len(first))
    check_commas(path, rows, mark, list(zip(indexes, names, strict=True)))
    lines = np.array([number for number, _ in rows], dtype=np.int64)
    columns = _parse_fast([line for _, line in rows], mark, indexes)
    if columns is not None:
        return Table(path, lines, columns)
    begin = _cell(path, rows[0][1], mark, indexes[0])
    dated = dates and _is_date(begin)
    columns = _parse_slow(path, rows, mark, indexes, names, dated=dated)
    notices = clock_notices(path, lines, columns[0]) if dated and not _has_zone(begin) else ()
    return Table(path, lines, columns, dated, notices)


def read_header(path: Path) -> list[str]:
    """Return the names in the first line of a file; empty if it holds values.

    Parameters
    ----------
    path : path
        CSV file, plain or gzip.
    """
    lines = [x for x in _read_text(path).splitlines() if x.strip()]
    if not lines:
        msg = f"{path}: is empty; give a CSV file with rows"
        raise BagError(msg)
    mark = _find_separator(lines[:_PROBE_LINES])
    first = _cells(path, lines[0], mark)
    return [] if all(_is_value(cell, mark) for cell in first) else [c.strip() for c in first]


def _read_text(path: Path) -> str:
    return decode(path, unpacked(path)).lstrip("\ufeff")  # joined files carry more than one


def _find_separator(lines: Sequence[str]) -> str:
    """Return the separator that splits all first lines into equally many, and most, cells."""
    best, most = ",", 0
    for mark in _SEPARATORS:
        try:
            counts = {len(row) for row in csv.reader(lines, delimiter=mark)}
        except csv.Error:
            continue
        cells = counts.pop() if len(counts) == 1 else 1
        if cells > most:
            best, most = mark, cells
    return best


def _number(cell: str, separator: str) -> float | None:
    """Return the value of a cell, NaN for a known sign of no value, None for anything else."""
    text = cell.strip()
    if text.lower() in _NO_VALUE:
        return math.nan
    if separator != ",":
        text = text.replace(",", ".")
    return float(text) if _NUMBER.fullmatch(text) else None


def _is_value(cell: str, separator: str) -> bool:
    return _number(cell, separator) is not None or _is_date(cell)


def _is_date(cell: str) -> bool:
    return _date_s(cell) is not None


def _has_zone(cell: str) -> bool:
    return datetime.fromisoformat(cell.strip().replace("Z", "+00:00")).tzinfo is not None


def _date_s(cell: str) -> float | None:
    """Return seconds since 1970 of an ISO date and time, UTC unless it says otherwise."""
    try:
        when = datetime.fromisoformat(cell.strip().replace("Z", "+00:00"))
    except (ValueError, OverflowError):
        return None
    if when.tzinfo is None:
        when = when.replace(tzinfo=timezone.utc)
    return (when - _EPOCH).total_seconds()


def _index(path: Path, name: str, header: Sequence[str], width: int) -> int:
    if header.count(name) > 1:
        places = " and ".join(str(i) for i, cell in enumerate(header) if cell == name)
        msg = (
            f"{path}: column '{name}' stands {header.count(name)} times in the header; write "
            f"the number of the right one instead, counted from 0: {places}"
        )
        raise BagError(msg)
    if name in header:
        return header.index(name)
    if name.isdigit():
        if int(name) < width:
            return int(name)
        msg = f"{path}: there is no column {name}, the last is {width - 1}; count from 0"
        raise BagError(msg)
    if not header:
        msg = (
            f"{path}: column '{name}': the file has no header; write the number of the "
            "column, counted from 0"
        )
        raise BagError(msg)
    msg = f"{path}: there is no column '{name}'; {suggest(name, header)}"
    raise BagError(msg)


def _parse_fast(
    lines: Sequence[str], separator: str, indexes: Sequence[int]
) -> list[FloatArray] | None:
    """Parse plain numbers in one go; None where any cell needs a closer look."""
    if separator != "," and "," in lines[0]:
        lines = [line.replace(",", ".") for line in lines]
    try:
        table = np.loadtxt(
            lines,
            delimiter=separator,
            usecols=list(indexes),
            ndmin=2,
            comments=None,
            quotechar='"',
        )
    except (ValueError, IndexError):
        return None
    if len(table) != len(lines):
        return None
    return [np.ascontiguousarray(table[:, i]) for i in range(len(indexes))]


def _cells(path: Path, line: str, separator: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=separator))
    except csv.Error as err:
        msg = f"{path}: is no table ({err}); give a CSV file"
        raise BagError(msg) from err


def _cell(path: Path, line: str, separator: str, index: int) -> str:
    row = _cells(path, line, separator)
    return row[index] if index < len(row) else ""


def _parse_slow(
    path: Path,
    rows: Sequence[tuple[int, str]],
    separator: str,
    indexes: Sequence[int],
    names: Sequence[str],
    *,
    dated: bool,
) -> list[FloatArray]:
    columns = [np.empty(len(rows)) for _ in indexes]
    quoted = any('"' in line for _, line in rows)
    for at, (number, line) in enumerate(rows):
        cells = _cells(path, line, separator) if quoted else line.split(separator)
        for column, (index, name) in enumerate(zip(indexes, names, strict=True)):
            if index >= len(cells):
                msg = (
                    f"{path}:{number}: the row has {len(cells)} cells, column '{name}' is "
                    "missing; complete the row or remove it"
                )
                raise BagError(msg)
            read = _date_s if dated and column == 0 else lambda cell: _number(cell, separator)
            value = read(cells[index])
            if value is None:
                msg = (
                    f"{path}:{number}: column '{name}': '{cells[index]}' is no number; "
                    "correct it or leave the cell empty"
                )
                raise BagError(msg)
            columns[column][at] = value
    return columns
