# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read any text table: encoding, separator, preamble, decimal mark and units are found."""

from __future__ import annotations

import csv
import zlib
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.io.errors import BagError
from valve_twin.io.instruments.cells import RawColumn, Sheet, find_table
from valve_twin.io.instruments.table import check_size
from valve_twin.io.limits import unpack_gzip

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

_MARKS = ("\t", ";", "|", ",", " ")
_PROBE = 60  # lines by which the separator is found
_ENCODINGS = ["cp1252", "cp1251", "cp1250", "cp850", "cp932", "gb18030", "euc_kr"]
_LETTERS = 65_536  # bytes by which the encoding is found
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
    text = decode(path, _unpacked(path))
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip()]
    if not lines:
        msg = f"{path}: is empty; give a file with rows"
        raise BagError(msg)
    mark = _separator([line for _, line in lines])
    sheet = find_table(path, [(n, _cells(line, mark)) for n, line in lines])
    return _cycles_below_each_other(sheet)


def _unpacked(path: Path) -> bytes:
    try:
        check_size(path, path.stat().st_size)
        data = path.read_bytes()
        return unpack_gzip(data) if data.startswith(b"\x1f\x8b") else data
    except FileNotFoundError:
        msg = f"{path}: there is no such file"
        raise BagError(msg) from None
    except (OSError, EOFError, zlib.error) as err:
        msg = f"{path}: cannot be read ({err}); give a whole file, plain or gzip"
        raise BagError(msg) from err


def decode(path: Path, data: bytes) -> str:
    """Return bytes as text: by byte-order mark, UTF-8, UTF-16 without mark, else the likeliest.

    Raises
    ------
    BagError
        If it is no text.
    """
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16", errors="replace").lstrip("\ufeff")
    even, odd = data[:4096:2].count(0), data[1:4096:2].count(0)
    if even + odd:
        half = len(data[:4096]) // 4
        if max(even, odd) < half or min(even, odd) > 0:
            msg = f"{path}: is no text and of no kind that is read"
            raise BagError(msg)
        return data.decode("utf-16-le" if odd > even else "utf-16-be", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        pass
    try:
        from charset_normalizer import from_bytes
    except ImportError:
        return data.decode("cp1252", errors="replace")
    best = from_bytes(data[:_LETTERS], cp_isolation=_ENCODINGS).best()
    return data.decode(best.encoding if best else "cp1252", errors="replace")


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
