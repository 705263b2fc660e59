# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read any text table: encoding, separator, preamble, decimal mark and units are found."""

from __future__ import annotations

import csv
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.io.errors import BagError
from valve_twin.io.instruments.cells import (
    RawColumn,
    Sheet,
    assemble,
    find_layout,
    find_table,
    has_comma,
    read_rows,
)
from valve_twin.io.instruments.text.blocks import plain_body, read_fast
from valve_twin.io.instruments.text.encoding import decode, unpacked

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

LARGE = 1 << 20
"""Files of more bytes are read block by block."""

_MARKS = ("\t", ";", "|", ",", " ")
_PROBE = 60  # lines by which the separator is found
_CYCLE_COLUMNS = 100  # a nameless row of so many values is one cycle
_MOST_CYCLES = 0.5  # rows of such a file to its columns at most, or it is a table


def read_text_table(path: Path) -> Sheet:
    """Return the table of a text file, plain or gzip.

    Parameters
    ----------
    path : path
        The file. One nameless row of 100 values and more is one cycle; such rows are put below
        each other with the number of the cycle beside.

    Raises
    ------
    BagError
        One line with file, line, column and value.
    """
    data, sheet = unpacked(path), None
    if len(data) > LARGE:
        with suppress(BagError):  # the whole decides, and tells the line
            sheet = _in_blocks(path, data)
    return _cycles_below_each_other(sheet or _as_a_whole(path, data))


def _as_a_whole(path: Path, data: bytes) -> Sheet:
    lines = _filled(decode(path, data), 1)
    if not lines:
        msg = f"{path}: is empty; give a file with rows"
        raise BagError(msg)
    mark = _separator([line for _, line in lines])
    return find_table(path, [(n, _cells(line, mark)) for n, line in lines])


def _in_blocks(path: Path, data: bytes) -> Sheet | None:
    """Return the table of a large file as `_as_a_whole` would, block by block.

    What it looks like is found from its first lines and some from all over it. None = that is not
    enough: the table begins later, or its commas may mean what only other rows show.
    """
    body = plain_body(data)
    if body is None:
        return None
    head = _filled(decode(path, data[: body.start], data), 1)
    some = [line for _, line in _filled("\n".join(body.some()), 1)]
    mark = _separator([line for _, line in head] + some)
    above = [(n, _cells(line, mark)) for n, line in head]
    probe = [(0, _cells(line, mark)) for line in some]
    layout, first = find_layout(path, above, probe)
    comma = has_comma(layout, above[first:] + probe)
    if len(above[first][1]) != layout.width or not body.reads_commas(
        mark, layout, probe, comma=comma
    ):
        return None
    blocks = [read_rows(path, layout, above[first:], comma=comma)]
    for line, block in body.blocks():
        found = read_fast(block, mark, layout, line, comma=comma)
        if found is None:
            rows = [(n, _cells(text, mark)) for n, text in _filled(block.decode("ascii"), line)]
            found = read_rows(path, layout, rows, comma=comma)
        blocks.append(found)
    return assemble(path, layout, blocks)


def _filled(text: str, first: int) -> list[tuple[int, str]]:
    """Return the lines that are not empty with their numbers, of which the first is given."""
    return [(n, line) for n, line in enumerate(text.splitlines(), first) if line.strip()]


def _separator(lines: Sequence[str]) -> str:
    """Return what divides the most numbers in the rows beyond the preamble."""
    probe = [*lines[-_PROBE:], *lines[len(lines) // 2 : len(lines) // 2 + _PROBE]]
    best, most = ",", 0.0
    for mark in _MARKS:
        counts = [len(_cells(line, mark)) for line in probe]
        usual = max(set(counts), key=counts.count)
        steady = counts.count(usual) / len(counts)
        if mark == "," and _decimal_commas(probe):
            continue
        if usual > 1 and steady > most + 0.05:
            best, most = mark, steady
    return best


def _decimal_commas(lines: Sequence[str]) -> bool:
    """Whether commas stand inside numbers that something else divides."""
    return all(any(m in line.strip() for m in ";\t|") for line in lines)


def _cells(line: str, mark: str) -> list[str]:
    if mark == " ":
        return line.split()
    if '"' not in line:
        return line.split(mark)
    try:
        return next(csv.reader([line], delimiter=mark, strict=True))
    except (csv.Error, StopIteration):  # a sign of inches, or a quote that nobody closed
        return [cell.strip().strip('"') for cell in line.split(mark)]


def _cycles_below_each_other(sheet: Sheet) -> Sheet:
    """Turn a table of one cycle a row into columns: the values, and the number of the cycle."""
    rows, columns = len(sheet.lines), [c for c in sheet.columns if not c.dated]
    if sheet.named or len(columns) < _CYCLE_COLUMNS or rows > _MOST_CYCLES * len(columns):
        return sheet
    table = np.column_stack([c.values for c in columns])
    numbers = np.repeat(np.arange(rows, dtype=np.float64), table.shape[1])
    made = [RawColumn("value", "", table.ravel()), RawColumn("cycle", "", numbers)]
    told = f"{sheet.path}: {rows} nameless rows of {table.shape[1]} values: one cycle a row"
    lines = np.repeat(sheet.lines, table.shape[1])
    return Sheet(sheet.path, lines, made, sheet.preamble, [*sheet.notices, told], named=True)
