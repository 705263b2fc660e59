# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read the sheet of an Excel workbook that holds the most rows, by openpyxl."""

from __future__ import annotations

import zipfile
from datetime import date, datetime, time
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

from valve_twin.io.errors import BagError
from valve_twin.io.instruments.cells import find_table
from valve_twin.io.instruments.table import MOST_COLUMNS, check_size, load_package

if TYPE_CHECKING:
    from pathlib import Path

    from valve_twin.io.instruments.cells import Sheet

_MOST_ROWS = 1_048_576  # of a sheet, by the format
_MOST_CELLS = 10_000_000  # of a sheet, with those left empty before the last one of a row
_MOST_TEXT = 32 << 20  # of the texts that cells share, each of which is read first [B]


def read_excel(path: Path) -> Sheet:
    """Return the table of a workbook.

    Parameters
    ----------
    path : path
        An .xlsx or .xlsm file; values that formulas had when it was saved are read.

    Raises
    ------
    BagError
        If it is no workbook, unpacks to more than allowed, or holds no table.
    """
    openpyxl = load_package("openpyxl", path)
    try:
        with zipfile.ZipFile(path) as archive:
            check_size(path, sum(item.file_size for item in archive.infolist()))
            shared = _shared_texts(archive)
        _check_at_most(path, shared, _MOST_TEXT, f"{_MOST_TEXT >> 20} MB of texts")
        book = openpyxl.load_workbook(path, read_only=True, data_only=True)
        try:
            found = [_rows(path, sheet) for sheet in book.worksheets]
        finally:
            book.close()
    except BagError:
        raise
    except Exception as err:  # whatever a broken workbook makes the reader raise
        msg = f"{path}: is no whole Excel workbook ({type(err).__name__}: {err}); save it anew"
        raise BagError(msg) from err
    rows = max(found, key=len, default=[])
    if not rows:
        msg = f"{path}: no sheet holds rows; give a workbook with a row a sample"
        raise BagError(msg)
    return find_table(path, rows)


def _shared_texts(archive: zipfile.ZipFile) -> int:
    """Return the size of the parts with the texts that cells share [B]."""
    kinds = ElementTree.fromstring(archive.read("[Content_Types].xml"))
    shared = {
        part.get("PartName", "").lstrip("/")
        for part in kinds
        if part.get("ContentType", "").endswith("sharedStrings+xml")
    }
    return sum(item.file_size for item in archive.infolist() if item.filename in shared)


def _check_at_most(path: Path, found: int, most: int, what: str) -> None:
    if found > most:
        msg = f"{path}: holds more than {what}; give it as CSV"
        raise BagError(msg)


def _rows(path: Path, sheet: Any) -> list[tuple[int, list[str]]]:  # noqa: ANN401  openpyxl has no types
    """Return the rows of a sheet that are not empty, all as wide as the widest.

    The size that the sheet claims is not believed: its rows would be filled up to it.
    """
    sheet.reset_dimensions()
    rows: list[tuple[int, list[str]]] = []
    seen = 0
    for n, row in enumerate(sheet.iter_rows(values_only=True, max_row=_MOST_ROWS), 1):
        seen += len(row)
        _check_at_most(path, seen, _MOST_CELLS, f"{_MOST_CELLS} cells")
        cells = [_text(v) for v in row[:MOST_COLUMNS]]
        if any(cells):
            rows.append((n, cells))
    widest = max((max(i for i, c in enumerate(cells) if c) + 1 for _, cells in rows), default=0)
    _check_at_most(path, widest * len(rows), _MOST_CELLS, f"{_MOST_CELLS} cells")
    return [(n, [*cells, *[""] * widest][:widest]) for n, cells in rows]


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, (datetime, date, time)):
        return value.isoformat(sep=" ") if isinstance(value, datetime) else value.isoformat()
    return repr(value) if isinstance(value, float) else str(value)
