# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Columns of a test-bench record: names with units, such as gap_mm or current_A, read in SI."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.bench_fit import UNITS
from valve_twin.io.errors import BagError
from valve_twin.io.tables.csv import read_header, read_table

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.bench_fit import Column


def read_bench_record(path: Path, columns: Sequence[Column]) -> dict[str, FloatArray]:
    """Return the columns of a record in SI units, (N,) each, by their names without the unit.

    Parameters
    ----------
    path : path
        CSV file with a header.
    columns : sequence of Column
        What is read.

    Raises
    ------
    BagError
        If a column is missing, stands twice, has no unit or an unknown one, or holds a cell
        without a number.
    """
    header = read_header(path)
    found = [_find(path, header, column) for column in columns]
    table = read_table(path, [name for name, _ in found])
    values = {}
    for column, (name, size), cells in zip(columns, found, table.columns, strict=True):
        bad = np.flatnonzero(~np.isfinite(cells))
        if len(bad):
            msg = (
                f"{path}:{table.lines[bad[0]]}: column '{name}': no finite number; a bench record "
                "must be whole: remove the row"
            )
            raise BagError(msg)
        values[column.name] = size * cells
    return values


def _find(path: Path, header: Sequence[str], column: Column) -> tuple[str, float]:
    """Return the name of a column in the file and what 1 of it is in SI."""
    known = UNITS[column.measures]
    hits = [name for name in header if name.rpartition("_")[0] == column.name]
    asked = " or ".join(f"{column.name}_{unit}" for unit in known) or f"{column.name}_UNIT"
    if len(hits) == 1:
        unit = hits[0].rpartition("_")[2]
        if not known or unit in known:
            return hits[0], known.get(unit, 1.0)
        msg = f"{path}: column '{hits[0]}': unit '{unit}' is not known; name it {asked}"
    elif hits:
        msg = f"{path}: columns {' and '.join(hits)} say the same; keep one"
    elif column.name in header:
        msg = f"{path}: column '{column.name}' has no unit; name it {asked}"
    else:
        given = ", ".join(header) or "none"
        msg = f"{path}: there is no column {asked} ({column.about}); the file has {given}"
    raise BagError(msg)
