# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Find the table in rows of cells: preamble, names, units, first row of data, decimal marks."""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from valve_twin.io.errors import BagError
from valve_twin.io.instruments.dates import is_date, read_dates
from valve_twin.io.instruments.table import MOST_COLUMNS, unique_name
from valve_twin.io.instruments.units import known_unit, split_name

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from valve_twin.core.types import FloatArray, IntArray

Rows: TypeAlias = "Sequence[tuple[int, Sequence[str]]]"
"""Lines of a file, counted from 1, and their cells."""

_NO_VALUE = {
    *("nan", "null", "none", "n/a", "na", "-", "--", "---", "bad", "#n/a", "#nv", "#value!"),
    *("#wert!", "ovl", "overrange", "over", "inf", "-inf"),
}
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eEdD][-+]?\d+)?", re.ASCII)
_LOOSE = re.compile(r"[-+]?[\d.,' ]*\d[\d.,' ]*([eEdD][-+]?\d+)?", re.ASCII)
_GROUPED = re.compile(r"[-+]?[1-9]\d{0,2}(,\d{3})+", re.ASCII)
_SAMPLED = 400  # rows by which the table is found
_NUMERIC = 0.9  # share of values in a column of numbers
_ABOVE = 4  # rows above the data in which names and units are looked for
_NAMED = 0.6  # share of the columns that a row of names fills


@dataclass(frozen=True, slots=True)
class RawColumn:
    """One column: name, unit, values (N,) [unit], NaN = none; dated = seconds since 1970 [s]."""

    name: str
    unit: str
    values: FloatArray
    dated: bool = False
    zoned: bool = False


@dataclass(frozen=True, slots=True)
class Sheet:
    """A table.

    Attributes
    ----------
    path : Path
        The file.
    lines : (N,) int array
        Line of every row in the file.
    columns : list of RawColumn
        Of numbers and dates.
    preamble : tuple of str
        Lines above, their cells joined by blanks.
    notices : list of str
        What was left out.
    named : bool
        Whether the file names its columns.
    """

    path: Path
    lines: IntArray
    columns: list[RawColumn]
    preamble: tuple[str, ...]
    notices: list[str]
    named: bool


def find_table(path: Path, rows: Rows) -> Sheet:
    """Return the table that rows of cells hold.

    Parameters
    ----------
    path : path
        The file, for messages.
    rows : sequence of (int, sequence of str)
        Line numbers and cells; empty lines are left out.

    Raises
    ------
    BagError
        If there is no table of numbers, or commas can be read in two ways.
    """
    width, numeric = _shape(path, rows)
    first = _first_row(rows, width, numeric)
    data = [r for r in rows[first:] if len(r[1]) in {width, width - 1}]
    notices = _left_out(path, rows[first:], width)
    kept = [r for r in data if _fits(r[1], numeric)]
    if len(kept) < len(data):
        bad = next(r for r in data if not _fits(r[1], numeric))
        text = next(c for i, c in enumerate(bad[1]) if i in numeric and not _is_value(c))
        notices.append(
            f"{path}:{bad[0]}: '{text[:40]}' stands where numbers stand; "
            f"{len(data) - len(kept)} such rows are left out"
        )
    names, units, top = _header(rows, first, width)
    columns, told = _columns(path, kept, numeric, (names, units))
    preamble = tuple(" ".join(c for c in cells if c.strip()) for _, cells in rows[:top])
    lines = np.array([number for number, _ in kept], dtype=np.int64)
    return Sheet(path, lines, columns, preamble, notices + told, bool(any(names)))


def _spread(rows: Rows) -> Rows:
    step = max(1, len(rows) // _SAMPLED)
    return rows[::step]


def _shape(path: Path, rows: Rows) -> tuple[int, frozenset[int]]:
    """Return how many cells a row of data has, and which of them hold values."""
    widths: Counter[int] = Counter()
    for _, cells in _spread(rows):
        if sum(map(_is_value, cells)) * 2 > sum(bool(c.strip()) for c in cells):
            widths[len(cells)] += 1
    if not widths:
        msg = f"{path}: holds no table of numbers; export the channels with a row a sample"
        raise BagError(msg)
    width = max(widths, key=lambda w: (widths[w], w))
    if width > MOST_COLUMNS:
        msg = f"{path}: rows of {width} cells, allowed are {MOST_COLUMNS}; export fewer channels"
        raise BagError(msg)
    bulk = [cells for _, cells in _spread(rows) if len(cells) == width]
    bulk = bulk[len(bulk) // 4 :]  # the preamble stands above
    numeric = set()
    for i in range(width):
        filled = [cells[i] for cells in bulk if cells[i].strip()]
        good = sum(map(_is_value, filled))
        if filled and good >= _NUMERIC * len(filled):
            numeric.add(i)
    if not numeric:
        msg = f"{path}: no column holds numbers; export the channels with a row a sample"
        raise BagError(msg)
    return width, frozenset(numeric)


def _fits(cells: Sequence[str], numeric: frozenset[int]) -> bool:
    """Whether a row may be data: half of the columns of numbers hold one."""
    here = [cells[i] for i in numeric if i < len(cells)]
    filled = [c for c in here if c.strip()]
    return bool(filled) and 2 * sum(map(_is_value, filled)) > len(filled)


def _first_row(rows: Rows, width: int, numeric: frozenset[int]) -> int:
    for at, (_, cells) in enumerate(rows):
        if len(cells) == width and _whole(cells, numeric):
            return at
    return 0


def _whole(cells: Sequence[str], numeric: frozenset[int]) -> bool:
    here = [cells[i].strip() for i in numeric]
    return any(map(_is_value, filter(None, here))) and all(not c or _is_value(c) for c in here)


def _left_out(path: Path, rows: Rows, width: int) -> list[str]:
    odd = [(n, len(c)) for n, c in rows if len(c) not in {width, width - 1}]
    if not odd:
        return []
    return [
        f"{path}:{odd[0][0]}: the row has {odd[0][1]} cells, the others have {width}; "
        f"{len(odd)} such rows are left out"
    ]


def _header(rows: Rows, first: int, width: int) -> tuple[list[str], list[str], int]:
    """Return names and units, empty where there are none, and where the preamble ends."""
    names, units, top = [""] * width, [""] * width, first
    for at in range(first - 1, max(-1, first - 1 - _ABOVE), -1):
        cells = [c.strip() for c in rows[at][1]]
        filled = [c for c in cells if c]
        if not width - 1 <= len(cells) <= width + 1 or len(filled) < _NAMED * width:
            if len(cells) < 2 or not any(units):
                break
            continue
        cells = [*cells, ""][:width]
        if not any(units) and sum(known_unit(c) is not None for c in filled) * 2 > len(filled):
            units, top = [c.strip("[]()") for c in cells], at
            continue
        names, top = cells, at
        break
    return names, units, top


def _columns(
    path: Path, rows: Rows, numeric: frozenset[int], header: tuple[list[str], list[str]]
) -> tuple[list[RawColumn], list[str]]:
    names, units = header
    columns: list[RawColumn] = []
    notices: list[str] = []
    taken: set[str] = set()
    texts = {i: [c[i].strip() if i < len(c) else "" for _, c in rows] for i in sorted(numeric)}
    comma = any(_is_decimal_comma(cells) for cells in texts.values())
    for i, cells in texts.items():
        unit = units[i] or split_name(names[i])[1]
        name = unique_name(names[i] or str(i), taken)
        taken.add(name)
        if any(is_date(c) for c in cells[:1]):
            values, zoned = read_dates(path, [n for n, _ in rows], name, cells)
            columns.append(RawColumn(name, "s", values, dated=True, zoned=zoned))
            continue
        values, told = _numbers(path, rows, name, cells, comma=comma)
        columns.append(RawColumn(name, unit, values))
        notices += told
    return columns, notices


def _is_value(cell: str) -> bool:
    text = cell.strip()
    if _LOOSE.fullmatch(text) or text.lower() in _NO_VALUE:
        return True
    return len(text) > 5 and is_date(text)


def _is_decimal_comma(cells: Sequence[str]) -> bool:
    """Whether a column shows beyond doubt that commas stand before decimals."""
    return any(
        "," in c and not _GROUPED.fullmatch(c) and c.count(",") == 1 and c.rfind(".") < c.find(",")
        for c in cells
    )


def _numbers(
    path: Path, rows: Rows, name: str, cells: Sequence[str], *, comma: bool
) -> tuple[FloatArray, list[str]]:
    """Return the numbers of a column; what is none is left out and told."""
    if not any("_" in c or "," in c for c in cells):
        try:
            return np.array([c or "nan" for c in cells]).astype(np.float64), []
        except ValueError:
            pass
    if not comma:
        _refuse_doubt(path, rows, name, cells)
    values = np.full(len(cells), math.nan)
    bad: list[int] = []
    for at, cell in enumerate(cells):
        text = _plain(cell, comma=comma)
        if text and _NUMBER.fullmatch(text):
            values[at] = float(text.lower().replace("d", "e"))
        elif cell and cell.lower() not in _NO_VALUE:
            bad.append(at)
    if not bad:
        return values, []
    line, cell = rows[bad[0]][0], cells[bad[0]]
    return values, [
        f"{path}:{line}: column '{name}': '{cell[:40]}' is no number and is left out "
        f"({len(bad)} such cells); correct it or leave the cell empty"
    ]


def _plain(cell: str, *, comma: bool) -> str:
    text = cell.replace(" ", "").replace("'", "")
    if not comma:
        return text.replace(",", "")
    return text.replace(".", "").replace(",", ".") if "," in text else text


def _refuse_doubt(path: Path, rows: Rows, name: str, cells: Sequence[str]) -> None:
    """Refuse commas before three digits where nothing in the file says what they are."""
    for at, cell in enumerate(cells):
        if "," in cell and cell.count(",") == 1 and "." not in cell:
            msg = (
                f"{path}:{rows[at][0]}: column '{name}': '{cell}': the comma may stand before "
                "decimals or between thousands; export with a decimal point and nothing between "
                "thousands"
            )
            raise BagError(msg)
