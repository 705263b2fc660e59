# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read Parquet files by pyarrow."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from valve_twin.io.errors import BagError
from valve_twin.io.instruments.cells import RawColumn, Sheet
from valve_twin.io.instruments.table import check_count, check_size, load_package
from valve_twin.io.instruments.units import split_name

if TYPE_CHECKING:
    from pathlib import Path

_DATED = ("timestamp", "date")
_NUMERIC = ("int", "uint", "float", "double", "halffloat", "bool", "decimal")


def read_parquet(path: Path) -> Sheet:
    """Return the columns of a Parquet file that hold numbers or dates.

    Parameters
    ----------
    path : path
        The file; a unit is taken from the field's metadata or its name.

    Raises
    ------
    BagError
        If it is no whole Parquet file, too large, or holds no numbers.
    """
    parquet = load_package("pyarrow.parquet", path)
    try:
        file = parquet.ParquetFile(path)
        fields = [f for f in file.schema_arrow if _kind(f)]
        check_size(path, 8 * file.metadata.num_rows * max(1, len(fields)))
        check_count(path, len(fields))
        columns = [_column(f, file.read([f.name], use_threads=False).column(0)) for f in fields]
    except BagError:
        raise
    except Exception as err:  # whatever a broken file makes the reader raise
        msg = f"{path}: is no whole Parquet file ({type(err).__name__}: {err}); write it anew"
        raise BagError(msg) from err
    return Sheet(path, np.arange(1, file.metadata.num_rows + 1), columns, (), [], named=True)


def _kind(field: Any) -> str:  # noqa: ANN401  pyarrow has no types
    kind = str(field.type)
    if kind.startswith(_DATED):
        return "date"
    return "number" if kind.startswith(_NUMERIC) else ""


def _column(field: Any, values: Any) -> RawColumn:  # noqa: ANN401  pyarrow has no types
    unit = (field.metadata or {}).get(b"unit", b"").decode(errors="replace")
    if _kind(field) == "date":
        stamps = values.to_numpy().astype("datetime64[ns]")
        seconds = np.where(np.isnat(stamps), np.nan, stamps.astype(np.int64) * 1e-9)
        return RawColumn(field.name, "s", seconds, dated=True, zoned=True)
    unit = unit or split_name(field.name)[1]
    numbers = np.asarray(values.to_numpy(), dtype=np.float64)
    return RawColumn(field.name, unit, numbers)
