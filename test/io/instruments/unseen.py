# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What no reader can see of a changed byte, and what has to be told of all others.

Most files of instruments carry no check sums: a changed byte of a number is another number, one
of a name another name. Such bytes are found in the sound file by what was written into it. All
else that a mutation changes in what is read has to be told: another length, row or column.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import pytest

from test.io.instruments.foreign_files import COMMAND, PRESSURE, SECONDS, START

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from valve_twin.io.instruments.table import Column, Recording

_WORDS = {
    "mat5": ("time_s", "log", "setpoint", "p_bar", "gain", "note"),
    "mat73": ("time_s", "log", "setpoint", "p", "unit", "bar"),
    "tdms": ("log", "setpoint", "p", "unit_string", "wf_increment", "wf_start_time", "%", "bar"),
    "mdf": ("setpoint", "p", "time", "t", "%", "bar", "s"),
    "parquet": (),
    "excel": (),
    "sqlite": ("/p", "sensor_msgs/msg/FluidPressure"),
}
"""Names and units as they were written."""


@dataclass(slots=True)
class Places:
    """What stands where in a sound file.

    Attributes
    ----------
    values : dict of str to list of (int, int, int)
        Of each part of a column's name: begin, end and row of the bytes of a value; -1 = of any
        row.
    times : list of (int, int, int)
        Likewise the times.
    words, steps : list of (int, int)
        Names, units; increments and dates that stand once for many rows.
    """

    values: dict[str, list[tuple[int, int, int]]] = field(default_factory=dict)
    times: list[tuple[int, int, int]] = field(default_factory=list)
    words: list[tuple[int, int]] = field(default_factory=list)
    steps: list[tuple[int, int]] = field(default_factory=list)


def places_of(kind: str, path: Path) -> Places:
    """Return what stands where in a file of `foreign_files`."""
    data, found = path.read_bytes(), Places()
    found.words = [_padded(data, *at) for word in _WORDS[kind] for at in _all(data, word.encode())]
    found.words += [at for word in _WORDS[kind] for at in _all(data, word.encode("utf-16-le"))]
    if kind in {"mat5", "mat73", "tdms"}:
        for name, array in (("setpoint", COMMAND), ("p", PRESSURE)):
            found.values[name] = _rows(data, array)
    if kind in {"mat5", "mat73"}:
        found.times = _rows(data, SECONDS)
    if kind == "mat73":
        _hdf5(path, data, found)
    if kind == "tdms":
        for key, size in ((b"wf_increment", 8), (b"wf_start_time", 16)):
            found.steps += [(end + 4, end + 4 + size) for _, end in _all(data, key)]
    if kind == "mdf":
        for name, array in (("setpoint", COMMAND), ("p", PRESSURE)):
            (at, _), *_ = _all(data, np.column_stack((SECONDS, array)).tobytes())
            rows = range(len(array))
            found.times += [(at + 16 * r, at + 16 * r + 8, r) for r in rows]
            found.values[name] = [(at + 16 * r + 8, at + 16 * r + 16, r) for r in rows]
        stamp = round(START.timestamp() * 1e9).to_bytes(8, "little")
        found.steps += [(b, e + 8) for b, e in _all(data, stamp)]  # and its zone behind it
    if kind == "parquet":
        _parquet(path, data, found)
    if kind == "sqlite":
        _sqlite(data, found)
    return found


def _all(data: bytes, part: bytes) -> Iterator[tuple[int, int]]:
    at = data.find(part)
    while at >= 0:
        yield at, at + len(part)
        at = data.find(part, at + 1)


def _padded(data: bytes, begin: int, end: int) -> tuple[int, int]:
    """Take the zeros behind a name with it: another byte there is part of the name."""
    padded = begin + -(-(end + 1 - begin) // 8) * 8
    return begin, padded if not any(data[end:padded]) else end


def _rows(data: bytes, array: np.ndarray) -> list[tuple[int, int, int]]:
    return [
        (at + 8 * r, at + 8 * r + 8, r)
        for at, _ in _all(data, array.tobytes())
        for r in range(len(array))
    ]


def _parquet(path: Path, data: bytes, found: Places) -> None:
    """Take the packed pages for values of any row, the schema in the footer for names."""
    pq = pytest.importorskip("pyarrow.parquet")
    group = pq.ParquetFile(path).metadata.row_group(0)
    for i in range(group.num_columns):
        column = group.column(i)
        begin = column.dictionary_page_offset or column.data_page_offset
        place = (begin, begin + column.total_compressed_size, -1)
        name = column.path_in_schema
        if name == "when":
            found.times.append(place)
        else:
            found.values[name] = [place]
    ends = [p[0][1] for p in [*found.values.values(), found.times]]
    found.words.append((max(ends), len(data)))


def _hdf5(path: Path, data: bytes, found: Places) -> None:
    """Take for values of any row where a dataset says they stand, for names where a link says so.

    Neither stands under a check sum: another place that nothing else claims is as good.
    """
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "r") as file:
        for name, group in (("setpoint", "log"), ("p", "log"), ("time_s", "")):
            dataset = file[f"{group}/{name}"]
            at, size = dataset.id.get_offset(), dataset.id.get_storage_size()
            stated = (at - file.userblock_size).to_bytes(8, "little") + size.to_bytes(8, "little")
            places = [(begin, begin + 8, -1) for begin, _ in _all(data, stated)]
            found.values.setdefault(name, []).extend(places)
            found.times += places if name == "time_s" else []
    for _, end in _all(data, b"SNOD"):
        count = int.from_bytes(data[end + 2 : end + 4], "little")
        found.words += [(end + 4 + 40 * n, end + 12 + 40 * n) for n in range(count)]


def _sqlite(data: bytes, found: Places) -> None:
    found.values["fluid_pressure"] = places = []
    for value in (PRESSURE * 1e5).tolist():
        for at, end in _all(data, np.float64(value).tobytes() + bytes(8)):
            places.append((at, end - 8, -1))
            found.values.setdefault("variance", []).append((end - 8, end, -1))
            found.times.append((at - 16, at - 4, -1))


def touched(sound: bytes, data: bytes) -> np.ndarray:
    """Return the places of a file that another one of the same size holds otherwise: (K,) int."""
    a, b = (np.frombuffer(x, dtype=np.uint8) for x in (sound, data))
    return np.flatnonzero(a != b)


def may_be(found: Recording, sound: Recording, places: Places, at: np.ndarray) -> bool:
    """Return whether a silent result differs only where no reader can see it.

    Parameters
    ----------
    found, sound : Recording
        What was read of the mutated and of the sound file.
    places : Places
        Of the sound file.
    at : (K,) int array
        Places that the mutation changed.
    """
    hit = np.zeros(int(at.max(initial=0)) + 2, dtype=bool)
    hit[at] = True

    def is_hit(begin: int, end: int) -> bool:
        return bool(hit[begin:end].any())

    words = any(is_hit(*p) for p in places.words)
    steps = any(is_hit(*p) for p in places.steps)
    times = any(is_hit(b, e) for b, e, _ in places.times)
    if len(found.columns) != len(sound.columns):
        return False
    columns = found.columns
    names = [c.name for c in sound.columns]
    if words and sorted(c.name for c in columns) == sorted(names):  # a group's name orders them
        columns = tuple(sorted(columns, key=lambda c: names.index(c.name)))
    for one, other in zip(columns, sound.columns, strict=True):
        if (one.name, one.unit) != (other.name, other.unit) and not words:
            return False
        if len(one.values) != len(other.values):
            return False
        moved = not np.array_equal(one.seconds, other.seconds)
        if moved and not (times or steps or words):
            return False
        rows = np.flatnonzero(one.values.view(np.int64) != other.values.view(np.int64))
        if len(rows) and not _explained(rows, other, places, is_hit):
            return False
    return found.start_ns == sound.start_ns or times or steps


def _explained(rows: np.ndarray, column: Column, places: Places, is_hit: object) -> bool:
    """Return whether bytes of just these values were changed."""
    assert callable(is_hit)
    name = max((n for n in places.values if n in column.name), key=len, default="")
    changed = {row for begin, end, row in places.values.get(name, ()) if is_hit(begin, end)}
    return -1 in changed or set(rows.tolist()) <= changed


def may_be_text(found: Recording, sound: Recording, data: bytes, before: bytes) -> bool:
    """Return whether only numbers in changed lines of a text differ, the others not.

    Parameters
    ----------
    found, sound : Recording
        What was read of the mutated and of the sound file.
    data, before : bytes
        The mutated and the sound file.
    """
    new, old = (x.replace(b"\r\n", b"\n").rstrip(b"\n").split(b"\n") for x in (data, before))
    same = 0
    while same < min(len(new), len(old)) and new[same] == old[same]:
        same += 1
    tail = 0
    while tail < min(len(new), len(old)) - same and new[-1 - tail] == old[-1 - tail]:
        tail += 1
    head = len(old) - len(SECONDS)
    first = max(0, same - head)
    if len(found.columns) != len(sound.columns):
        return False
    for one, other in zip(found.columns, sound.columns, strict=True):
        rows = len(one.values) - len(other.values)
        if rows != len(new) - len(old):
            return False
        if same >= head and (one.name, one.unit) != (other.name, other.unit):
            return False
        last = min(tail, len(other.values))
        if one.values[:first].tolist() != other.values[:first].tolist():
            return False
        if last and one.values[-last:].tolist() != other.values[-last:].tolist():
            return False
        if first > 1 and one.seconds[:first].tolist() != other.seconds[:first].tolist():
            return False
    return True
