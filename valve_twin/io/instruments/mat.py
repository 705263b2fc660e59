# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read MATLAB files, v5 by scipy and v7.3 by h5py, and other HDF5 files of the same shape."""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from valve_twin.io.errors import BagError
from valve_twin.io.instruments.cells import RawColumn, Sheet
from valve_twin.io.instruments.table import check_count, check_size, load_package
from valve_twin.io.instruments.units import split_name
from valve_twin.io.limits import unpack_limit

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from valve_twin.core.types import FloatArray

_MOST_DEPTH = 8
_LARGEST_WHOLE = 2.0**53  # beyond it doubles, as which all is read, tell whole numbers not apart
_DATES_NS = 0.9e18, 4.1e18  # 1998 to 2099; the bits of a measured double are more
_HUGE = 1e30
_FEWEST = 3  # values of a channel
_ARRAYS = 64  # columns of one matrix that are channels
_HEAD = 128  # bytes before the first element of versions 5 to 7
_ORDERS = {b"IM": "<", b"MI": ">"}  # of bytes, by the end of that head
_MATRIX, _PACKED = 14, 15  # kinds of elements that hold others
_WIDTHS = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}  # of a number [B]
_ELEMENT = 256  # what an element takes beside its numbers, assumed [B]
_MOST_NESTED = 32  # the reader calls itself for each cell inside a cell


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
        _check_content(path)
        found = loadmat(path, simplify_cells=True)
    except BagError:
        raise
    except Exception as err:  # whatever a broken file makes the reader raise
        msg = f"{path}: is no whole MAT file ({type(err).__name__}: {err}); save it anew"
        raise BagError(msg) from err
    public = {k: v for k, v in found.items() if not k.startswith("__")}
    return _sheet(path, list(_vectors(public, "")), {})


def _check_content(path: Path) -> None:
    """Refuse what unpacks to too much below its structures and cells, whose sizes nobody claims.

    Raises
    ------
    BagError
        Names the limit.
    """
    data = path.read_bytes()
    order = _ORDERS.get(data[_HEAD - 2 : _HEAD])
    size, at = 0, _HEAD
    while order and at + 8 <= len(data):
        kind, length = struct.unpack_from(f"{order}II", data, at)
        held, at = memoryview(data)[at : at + 8 + length], at + 8 + length
        if kind == _PACKED:
            held = memoryview(zlib.decompressobj().decompress(held[8:], unpack_limit() + 1))
            check_size(path, len(held))
        size += _size_of(path, held, order)
        check_size(path, size)


def _size_of(path: Path, held: memoryview, order: str) -> int:
    """Return what elements take as doubles [B]; stops where that is more than allowed."""
    size, limit = 0, unpack_limit()
    inside = [(0, len(held), 0)]
    while inside:
        at, end, depth = inside.pop()
        if depth > _MOST_NESTED:
            msg = f"{path}: its cells are nested deeper than {_MOST_NESTED} levels; save them flat"
            raise BagError(msg)
        while at + 8 <= end and size <= limit:
            kind, length = struct.unpack_from(f"{order}II", held, at)
            start, behind = at + 8, at + 8 + -(-length // 8) * 8
            if kind >> 16:  # four bytes at most stand in the tag itself
                kind, length, behind = kind & 0xFFFF, kind >> 16, start
            if kind == _MATRIX:
                inside.append((start, min(start + length, end), depth + 1))
            size += _ELEMENT + 8 * (length // _WIDTHS[kind] if kind in _WIDTHS else 0)
            at = behind
    return size


def read_hdf5(path: Path) -> Sheet:
    """Return the datasets of a MAT v7.3 or another HDF5 file as a table; see `read_mat`."""
    h5py = load_package("h5py", path)
    units: dict[str, str] = {}
    arrays: list[tuple[str, FloatArray]] = []
    odd: list[str] = []
    try:
        with h5py.File(path, "r") as file:
            found = list(_datasets(file, "", h5py, set()))
            check_size(path, sum(int(d.size) * 8 for _, d in found))
            odd += [
                f"{path}: the values of {two} stand at one place: its or theirs are wrong"
                for two in _overlaps(found, int(file.userblock_size), h5py)
            ]
            for name, dataset in found:
                values = np.asarray(dataset[()])
                if _is_misread(values):
                    odd.append(
                        f"{path}: '{name}' holds numbers that no measurement has: the file may "
                        "state their kind wrongly"
                    )
                arrays += _split(name, values.T)
                if _is_odd(dataset, h5py):
                    odd.append(
                        f"{path}: '{name}' is of no usual kind of numbers, its may be wrong"
                    )
                unit = _unit_of(dataset)
                units[name] = unit or ""
                if unit is None:
                    odd.append(f"{path}: the unit of '{name}' cannot be read")
    except BagError:
        raise
    except Exception as err:  # whatever a broken file makes the reader raise
        msg = f"{path}: is no whole HDF5 or MAT v7.3 file ({type(err).__name__}: {err})"
        raise BagError(msg) from err
    sheet = _sheet(path, arrays, units)
    return replace(sheet, notices=[*sheet.notices, *odd])


def _is_misread(values: np.ndarray[Any, Any]) -> bool:
    """Return whether numbers look like the bits of others: too large or too small for doubles."""
    sizes = np.abs(values[values != 0].astype(np.float64))
    if not len(sizes):
        return False
    least, most = float(np.nanmin(sizes)), float(np.nanmax(sizes))
    if values.dtype.kind in "iu":
        return most > _LARGEST_WHOLE and not _DATES_NS[0] <= least <= most < _DATES_NS[1]
    exact = values.dtype.kind == "f" and values.dtype.itemsize > 2  # halves are used to their end
    smallest = float(np.finfo(values.dtype).tiny) if exact else 0.0
    # what dies away comes as low, but not beside huge numbers
    return least < smallest and (most < smallest or most > _HUGE)


def _overlaps(found: Sequence[tuple[str, Any]], base: int, h5py: Any) -> Iterator[str]:  # noqa: ANN401
    """Yield names of what shares bytes: HDF5 has no check sum of where values stand."""
    spans = []
    for name, dataset in found:
        head = base + int(h5py.h5o.get_info(dataset.id).addr)
        spans.append((head, head + 1, f"'{name}'"))
        at = dataset.id.get_offset()  # None of what stands in chunks
        if at is not None:
            spans.append((int(at), int(at) + int(dataset.id.get_storage_size()), f"'{name}'"))
    spans.sort()
    for (_, end, one), (begin, _, other) in pairwise(spans):
        if begin < end:
            yield f"{one} and {other}"


def _unit_of(dataset: Any) -> str | None:  # noqa: ANN401  h5py has no types
    """Return the unit that stands beside a dataset, empty = none, None where it is damaged."""
    try:
        held = dict(dataset.attrs)
    except (RuntimeError, OSError, KeyError, TypeError, ValueError):
        return None
    unit = held.get("unit", held.get("units", ""))
    return unit.decode() if isinstance(unit, bytes) else str(unit)


def _is_odd(dataset: Any, h5py: Any) -> bool:  # noqa: ANN401  h5py has no types
    """Return whether floating numbers have other bits than those of IEEE 754."""
    kind = dataset.id.get_type()
    usual = (getattr(h5py.h5t, f"IEEE_F{n}{order}E") for n in (16, 32, 64) for order in "LB")
    return dataset.dtype.kind == "f" and not any(kind == one for one in usual)


def _datasets(
    group: Any,  # noqa: ANN401  h5py has no types
    prefix: str,
    h5py: Any,  # noqa: ANN401
    seen: set[int],
    depth: int = 0,
) -> Iterator[tuple[str, Any]]:
    """Yield datasets of real numbers below a group, each once; none that lie in other files."""
    if depth > _MOST_DEPTH:
        return
    for name in group:
        if name.startswith("#") or not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue
        item = group[name]
        address = int(h5py.h5o.get_info(item.id).addr)
        if address in seen:
            continue
        seen.add(address)
        if isinstance(item, h5py.Group):
            yield from _datasets(item, f"{prefix}{name}.", h5py, seen, depth + 1)
        elif (
            item.dtype.kind in "fiub"
            and item.size >= _FEWEST
            and not (item.external or item.is_virtual)
        ):
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
