# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read MATLAB files, v5 by scipy and v7.3 by h5py, and other HDF5 files of the same shape."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from valve_twin.io.errors import BagError
from valve_twin.io.instruments.cells import RawColumn, Sheet
from valve_twin.io.instruments.table import check_count, check_size, load_package
from valve_twin.io.instruments.units import split_name

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from valve_twin.core.types import FloatArray

_MOST_DEPTH = 8
_FEWEST = 3  # values of a channel
_ARRAYS = 64  # columns of one matrix that are channels


def read_mat(path: Path) -> Sheet:
    """Return the variables of a MAT file of version 4, 5, 6 or 7 as a table.

    Parameters
    ----------
    path : path
        Vectors, matrices with a channel a column, structures of both. Variables of another length
        than most are left out.

    Raises
    ------
    BagError
        If it is no whole MAT file, too large, or holds no vectors.
    """
    from scipy.io import loadmat, whosmat

    try:
        claimed = sum(8 * math.prod(shape) for _, shape, _ in whosmat(path))
        check_size(path, claimed)
        found = loadmat(path, simplify_cells=True)
    except BagError:
        raise
    except Exception as err:  # whatever a broken file makes the reader raise
        msg = f"{path}: is no whole MAT file ({type(err).__name__}: {err}); save it anew"
        raise BagError(msg) from err
    public = {k: v for k, v in found.items() if not k.startswith("__")}
    return _sheet(path, list(_vectors(public, "")), {})


def read_hdf5(path: Path) -> Sheet:
    """Return the datasets of a MAT v7.3 or another HDF5 file as a table; see `read_mat`."""
    h5py = load_package("h5py", path)
    units: dict[str, str] = {}
    arrays: list[tuple[str, FloatArray]] = []
    try:
        with h5py.File(path, "r") as file:
            found = list(_datasets(file, "", h5py))
            check_size(path, sum(int(d.size) * 8 for _, d in found))
            for name, dataset in found:
                arrays += _split(name, np.asarray(dataset[()]).T)
                unit = dataset.attrs.get("unit", dataset.attrs.get("units", ""))
                units[name] = unit.decode() if isinstance(unit, bytes) else str(unit)
    except BagError:
        raise
    except Exception as err:  # whatever a broken file makes the reader raise
        msg = f"{path}: is no whole HDF5 or MAT v7.3 file ({type(err).__name__}: {err})"
        raise BagError(msg) from err
    return _sheet(path, arrays, units)


def _datasets(group: Any, prefix: str, h5py: Any, depth: int = 0) -> Iterator[tuple[str, Any]]:  # noqa: ANN401
    """Yield datasets of real numbers below a group; links to elsewhere are not followed."""
    if depth > _MOST_DEPTH:
        return
    for name in group:
        if name.startswith("#") or not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue
        item = group[name]
        if isinstance(item, h5py.Group):
            yield from _datasets(item, f"{prefix}{name}.", h5py, depth + 1)
        elif item.dtype.kind in "fiub" and item.size >= _FEWEST and not item.external:
            yield f"{prefix}{name}", item


def _vectors(tree: Mapping[str, Any], prefix: str, depth: int = 0) -> list[tuple[str, FloatArray]]:
    found: list[tuple[str, FloatArray]] = []
    for name, value in tree.items():
        if isinstance(value, dict) and depth < _MOST_DEPTH:
            found += _vectors(value, f"{prefix}{name}.", depth + 1)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
            found += _split(f"{prefix}{name}", value)
    return found


def _split(name: str, value: FloatArray) -> list[tuple[str, FloatArray]]:
    """Return the channels of an array: its columns, or its rows where there are fewer of them."""
    array = np.squeeze(value)
    if array.ndim == 1 and len(array) >= _FEWEST:
        return [(name, array.astype(np.float64))]
    if array.ndim != 2 or min(array.shape) > _ARRAYS:
        return []
    columns = array if array.shape[0] >= array.shape[1] else array.T
    return [(f"{name}_{i + 1}", c.astype(np.float64)) for i, c in enumerate(columns.T)]


def _sheet(path: Path, arrays: list[tuple[str, FloatArray]], units: Mapping[str, str]) -> Sheet:
    lengths = [len(a) for _, a in arrays]
    check_count(path, len(arrays))
    count = max(set(lengths), key=lambda n: (lengths.count(n) * n, n))
    others = [name for name, a in arrays if len(a) != count]
    told = [f"{path}: {', '.join(others[:6])}: not of {count} values, left out"] if others else []
    kept = [
        RawColumn(name, units.get(name) or split_name(name)[1], a)
        for name, a in arrays
        if len(a) == count
    ]
    rows = np.arange(1, count + 1, dtype=np.int64)
    return Sheet(path, rows, kept, (), told, named=True)
