# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read the sheet of an Excel workbook that holds the most rows, by openpyxl."""

from __future__ import annotations

import zipfile
from datetime import date, datetime, time
from typing import TYPE_CHECKING

from valve_twin.io.errors import BagError
from valve_twin.io.instruments.cells import find_table
from valve_twin.io.instruments.table import MOST_COLUMNS, check_size, load_package

if TYPE_CHECKING:
    from pathlib import Path

    from valve_twin.io.instruments.cells import Sheet

_MOST_ROWS = 1_048_576  # of a sheet, by the format


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
        book = openpyxl.load_workbook(path, read_only=True, data_only=True)
        try:
            found = [_rows(sheet) for sheet in book.worksheets]
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


def _rows(sheet: object) -> list[tuple[int, list[str]]]:
    """Return the rows of a sheet that are not empty, all as wide as the widest."""
    values = sheet.iter_rows(values_only=True, max_row=_MOST_ROWS, max_col=MOST_COLUMNS)  # type: ignore[attr-defined]
    rows = [(n, [_text(v) for v in row]) for n, row in enumerate(values, 1)]
    rows = [(n, cells) for n, cells in rows if any(cells)]
    widest = max((max(i for i, c in enumerate(cells) if c) + 1 for _, cells in rows), default=0)
    return [(n, [*cells, *[""] * widest][:widest]) for n, cells in rows]


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, (datetime, date, time)):
        return value.isoformat(sep=" ") if isinstance(value, datetime) else value.isoformat()
    return repr(value) if isinstance(value, float) else str(value)
