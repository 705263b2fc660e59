# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Find the table in rows of cells: preamble, names, units, first row of data, decimal marks."""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from valve_twin.io.errors import BagError
from valve_twin.io.instruments.dates import as_cells, is_date, read_dates
from valve_twin.io.instruments.table import MOST_COLUMNS, unique_name
from valve_twin.io.instruments.units import known_unit, split_name

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from valve_twin.core.types import FloatArray, IntArray

Rows: TypeAlias = "Sequence[tuple[int, Sequence[str]]]"
"""Lines of a file, counted from 1, and their cells."""

_NO_VALUE = {
    *("nan", "null", "none", "n/a", "na", "-", "--", "---", "bad", "#n/a", "#nv", "#value!"),
    "#wert!",
}
_OVER = {"ovl", "overrange", "over", "inf", "+inf", "-inf", "infinity", "+infinity", "-infinity"}
"""What instruments write for a value over their range."""

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eEdD][-+]?\d+)?", re.ASCII)
_LOOSE = re.compile(r"[-+]?[\d.,' ]*\d[\d.,' ]*([eEdD][-+]?\d+)?", re.ASCII)
_GROUPED = re.compile(r"[-+]?[1-9]\d{0,2}(,\d{3})+", re.ASCII)
POINTED = re.compile(r"[-+]?[1-9]\d{0,2}(\.\d{3})+", re.ASCII)
"""A number whose points may divide thousands."""
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


@dataclass(frozen=True, slots=True)
class Layout:
    """What a table looks like.

    Attributes
    ----------
    width : int
        Cells of a row.
    numeric : tuple of int
        Which of them hold numbers or dates, rising.
    names, units : tuple of str
        Of these, the names each once; a unit is empty where there is none.
    dated : frozenset of int
        Which cells hold dates.
    named : bool
        Whether the file names its columns.
    preamble : tuple of str
        Lines above, their cells joined by blanks.
    """

    width: int
    numeric: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    dated: frozenset[int]
    named: bool
    preamble: tuple[str, ...]


_ODD, _UNFIT = -2, -1  # kinds of rows that are left out


@dataclass(slots=True)
class Told:
    """What was left out, by kind: a kind of rows, or the column in which a cell was.

    `first` is what is said of the first, before and behind their number.
    """

    first: dict[int, tuple[str, str]] = field(default_factory=dict)
    count: Counter[int] = field(default_factory=Counter)

    def add(self, kind: int, text: tuple[str, str], count: int = 1) -> None:
        """Count some of a kind, and keep what is said of the first.

        Parameters
        ----------
        kind : int
            A kind of rows, or a column.
        text : (str, str)
            What is said before and behind the number.
        count : int
            How many there are.
        """
        self.first.setdefault(kind, text)
        self.count[kind] += count

    def join(self, later: Told) -> None:
        """Add what was told of rows behind these."""
        for kind, text in later.first.items():
            self.add(kind, text, later.count[kind])

    def lines(self) -> list[str]:
        """Return one line a kind."""
        return [f"{a}{self.count[kind]}{b}" for kind, (a, b) in sorted(self.first.items())]


@dataclass(frozen=True, slots=True)
class Block:
    """Rows of a table: their lines, values (N,) or dates as texts (N,) by cell, what was told."""

    lines: IntArray
    columns: dict[int, NDArray[Any]]
    told: Told


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
    layout, first = find_layout(path, rows, rows)
    data = rows[first:]
    return assemble(path, layout, [read_rows(path, layout, data, comma=has_comma(layout, data))])


def find_layout(path: Path, head: Rows, some: Rows) -> tuple[Layout, int]:
    """Return what a table looks like and the first of its rows.

    Parameters
    ----------
    path : path
        The file, for messages.
    head, some : sequence of (int, sequence of str)
        The first rows of the file, with all above the table, and rows from all over it.

    Raises
    ------
    BagError
        If there is no table of numbers.
    """
    width, numeric = _shape(path, some)
    first = _first_row(head, width, numeric)
    names, units, top = _header(head, first, width)
    preamble = tuple(" ".join(c for c in cells if c.strip()) for _, cells in head[:top])
    taken: list[str] = []
    for i in numeric:
        taken.append(unique_name(names[i] or str(i), taken))
    sized = tuple(units[i] or split_name(names[i])[1] for i in numeric)
    fit = (c for _, c in head[first:] if len(c) in {width, width - 1} and _fits(c, numeric))
    row = next(fit, ())
    dated = frozenset(i for i in numeric if i < len(row) and is_date(row[i]))
    found = Layout(width, numeric, tuple(taken), sized, dated, any(names), preamble)
    return found, first


def has_comma(layout: Layout, rows: Rows) -> bool:
    """Return whether some number shows beyond doubt that commas stand before decimals."""
    widths = {layout.width, layout.width - 1}
    some = (c for _, c in rows if len(c) in widths and any("," in cell for cell in c))
    fit = [c for c in some if _fits(c, layout.numeric)]
    texts = ([c[i].strip() for c in fit if i < len(c)] for i in layout.numeric)
    return any(map(_is_decimal_comma, texts))


def read_rows(path: Path, layout: Layout, rows: Rows, *, comma: bool) -> Block:
    """Return what some rows hold; what does not fit is left out and told.

    Parameters
    ----------
    path : path
        The file, for messages.
    layout : Layout
        What its table looks like.
    rows : sequence of (int, sequence of str)
        Line numbers and cells.
    comma : bool
        Whether commas stand before decimals.

    Raises
    ------
    BagError
        If commas can be read in two ways.
    """
    told, kept, width = Told(), [], layout.width
    for row in rows:
        line, cells = row
        if len(cells) not in {width, width - 1}:
            begin = f"{path}:{line}: the row has {len(cells)} cells, the others have {width}; "
            told.add(_ODD, (begin, " such rows are left out"))
        elif not _fits(cells, layout.numeric):
            text = next(c for i, c in enumerate(cells) if i in layout.numeric and not _is_value(c))
            begin = f"{path}:{line}: '{text[:40]}' stands where numbers stand; "
            told.add(_UNFIT, (begin, " such rows are left out"))
        else:
            kept.append(row)
    lines = np.array([line for line, _ in kept], dtype=np.int64)
    columns: dict[int, NDArray[Any]] = {}
    for i, name in zip(layout.numeric, layout.names, strict=True):
        texts = [c[i].strip() if i < len(c) else "" for _, c in kept]
        if i in layout.dated:
            columns[i] = as_cells(texts)
            continue
        columns[i], bad = _numbers(path, lines, name, texts, comma=comma)
        if bad:
            begin = (
                f"{path}:{lines[bad[0]]}: column '{name}': '{texts[bad[0]][:40]}' is no number "
                "and is left out ("
            )
            told.add(i, (begin, " such cells); correct it or leave the cell empty"), len(bad))
    return Block(lines, columns, told)


def assemble(path: Path, layout: Layout, blocks: Sequence[Block]) -> Sheet:
    """Return the table that blocks of rows make.

    Parameters
    ----------
    path : path
        The file, for messages.
    layout : Layout
        What its table looks like.
    blocks : sequence of Block
        Its rows, in their order.

    Raises
    ------
    BagError
        Names the first cell of a column of dates that is none.
    """
    lines = np.concatenate([b.lines for b in blocks])
    told = Told()
    for block in blocks:
        told.join(block.told)
    columns: list[RawColumn] = []
    for i, name, unit in zip(layout.numeric, layout.names, layout.units, strict=True):
        whole = np.concatenate([b.columns[i] for b in blocks])
        if i in layout.dated:
            values, zoned = read_dates(path, lines, name, whole)
            columns.append(RawColumn(name, "s", values, dated=True, zoned=zoned))
        else:
            columns.append(RawColumn(name, unit, whole))
    return Sheet(path, lines, columns, layout.preamble, told.lines(), layout.named)


def _spread(rows: Rows) -> Rows:
    step = max(1, len(rows) // _SAMPLED)
    return rows[::step]


def _shape(path: Path, rows: Rows) -> tuple[int, tuple[int, ...]]:
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
    return width, tuple(sorted(numeric))


def _fits(cells: Sequence[str], numeric: Sequence[int]) -> bool:
    """Whether a row may be data: half of the columns of numbers hold one."""
    here = [cells[i] for i in numeric if i < len(cells)]
    filled = [c for c in here if c.strip()]
    return bool(filled) and 2 * sum(map(_is_value, filled)) > len(filled)


def _first_row(rows: Rows, width: int, numeric: Sequence[int]) -> int:
    for at, (_, cells) in enumerate(rows):
        if len(cells) == width and _whole(cells, numeric):
            return at
    return 0


def _whole(cells: Sequence[str], numeric: Sequence[int]) -> bool:
    here = [cells[i].strip() for i in numeric]
    return any(map(_is_value, filter(None, here))) and all(not c or _is_value(c) for c in here)


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


def _is_value(cell: str) -> bool:
    text = cell.strip()
    if _LOOSE.fullmatch(text) or text.lower() in _NO_VALUE or text.lower() in _OVER:
        return True
    return len(text) > 5 and is_date(text)


def _is_decimal_comma(cells: Sequence[str]) -> bool:
    """Whether a column shows beyond doubt that commas stand before decimals."""
    return any(
        "," in c and not _GROUPED.fullmatch(c) and c.count(",") == 1 and c.rfind(".") < c.find(",")
        for c in cells
    )


def _numbers(
    path: Path, lines: IntArray, name: str, cells: Sequence[str], *, comma: bool
) -> tuple[FloatArray, list[int]]:
    """Return the numbers of a column, and which cells hold something else."""
    if comma:
        _refuse_points(path, lines, name, cells)
    if not any("_" in c or "," in c or not c.isascii() for c in cells):
        try:
            values = np.array([c or "nan" for c in cells]).astype(np.float64)
        except ValueError:
            pass
        else:
            return values, []
    if not comma:
        _refuse_doubt(path, lines, name, cells)
    values = np.full(len(cells), math.nan)
    bad: list[int] = []
    for at, cell in enumerate(cells):
        text = _plain(cell, comma=comma)
        if text and _NUMBER.fullmatch(text):
            values[at] = float(text.lower().replace("d", "e"))
        elif cell.lower() in _OVER:
            values[at] = math.inf
        elif cell and cell.lower() not in _NO_VALUE:
            bad.append(at)
    return values, bad


def _plain(cell: str, *, comma: bool) -> str:
    text = cell.replace(" ", "").replace("'", "")
    if not comma:
        return text.replace(",", "")
    return text.replace(".", "").replace(",", ".") if "," in text else text


def _refuse_doubt(path: Path, lines: IntArray, name: str, cells: Sequence[str]) -> None:
    """Refuse commas before three digits where nothing in the file says what they are."""
    for at, cell in enumerate(cells):
        if "," in cell and cell.count(",") == 1 and "." not in cell:
            raise _doubt(path, lines[at], name, cell, "comma")


def _refuse_points(path: Path, lines: IntArray, name: str, cells: Sequence[str]) -> None:
    """Refuse points of a file with decimal commas that nothing in the column tells apart.

    Alone they may divide thousands; a number with point and comma contradicts decimal points.
    """
    commas = any("," in c for c in cells)
    decimal = any("." in c and "," not in c and not POINTED.fullmatch(c) for c in cells)
    for at, cell in enumerate(cells):
        both = "," in cell and "." in cell
        alone = "," not in cell and POINTED.fullmatch(cell)
        if (both and decimal) or (alone and (commas or not decimal)):
            raise _doubt(path, lines[at], name, cell, "point")


def _doubt(path: Path, line: int, name: str, cell: str, sign: str) -> BagError:
    return BagError(
        f"{path}:{line}: column '{name}': '{cell}': the {sign} may stand before decimals or"
        " between thousands; export with a decimal point and nothing between thousands"
    )
