# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read rosbag2 folders of storage sqlite3 by rosbags: every numeric field is a channel."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from valve_twin.io.errors import BagError
from valve_twin.io.instruments.sqlite_doubts import look_at
from valve_twin.io.instruments.table import Column, Recording, check_size, rising, unique, wild_row

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from valve_twin.core.types import BoolArray, FloatArray, IntArray

_MOST_DEPTH = 6
_ELEMENTS = 8  # of an array


def read_sqlite_bag(path: Path) -> Recording:
    """Return the numeric fields of the messages of a bag, by header stamp where there is one.

    Parameters
    ----------
    path : path
        The .db3 file or its folder.

    Raises
    ------
    BagError
        If it is no whole bag or too large.
    """
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    folder = path if path.is_dir() else path.parent
    found: dict[str, tuple[list[int], list[float]]] = {}
    notices: dict[str, str] = {}
    received, read = False, 0
    try:
        check_size(path, sum(f.stat().st_size for f in folder.glob("*.db3")))
        stored = look_at(folder)
        with AnyReader([folder], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as bag:
            for connection, log_ns, data in bag.messages():
                read += 1
                if connection.topic in notices:
                    continue
                try:
                    message = bag.deserialize(data, connection.msgtype)
                except Exception as err:  # one topic of an unknown type does not end the others
                    notices[connection.topic] = (
                        f"{path}: topic '{connection.topic}' is left out ({type(err).__name__})"
                    )
                    continue
                stamp = _stamp(message)
                received = received or stamp is None
                for name, value in _numbers(message, ""):
                    stamps, values = found.setdefault(f"{connection.topic}:{name}", ([], []))
                    stamps.append(log_ns if stamp is None else stamp)
                    values.append(value)
    except BagError:
        raise
    except Exception as err:  # whatever a broken bag makes the reader raise
        msg = f"{path}: is no whole bag ({type(err).__name__}: {err}); give its folder"
        raise BagError(msg) from err
    if not found:
        msg = f"{path}: holds no numeric field"
        raise BagError(msg)
    told = list(stored.notices)
    if read != stored.messages:
        told.append(
            f"{path}: {stored.messages - read} of {stored.messages} messages cannot be found:"
            " their topic or time is damaged, or metadata.yaml describes the topic otherwise"
        )
    rows = {name: _rising(*parts) for name, parts in found.items()}
    for name, (keep, _, _) in rows.items():
        topic = name.partition(":")[0]
        if not keep.all() and topic not in notices:
            wild = wild_row(np.array(found[name][0]) * 1e-9, keep)
            notices[topic] = f"{path}: topic '{topic}': stamp {wild}"
    start_ns = min(int(stamps[0]) for _, stamps, _ in rows.values())
    columns = [
        Column(name, "", 1e-9 * (stamps - start_ns).astype(np.float64), values)
        for name, (_, stamps, values) in rows.items()
    ]
    clock = "receive times" if received else "header stamps"
    return Recording(path, unique(columns), clock, measured=True, start_ns=start_ns,
                     notices=(*told, *notices.values()))  # fmt: skip


def _rising(stamps: list[int], values: list[float]) -> tuple[BoolArray, IntArray, FloatArray]:
    """Return which samples have times of one clock; their stamps [ns] and values."""
    all_ns = np.array(stamps, dtype=np.int64)
    keep = rising((all_ns - all_ns[0]).astype(np.float64))
    return keep, all_ns[keep], np.array(values, dtype=np.float64)[keep]


def _stamp(message: Any) -> int | None:  # noqa: ANN401  any message
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None or not hasattr(stamp, "sec"):
        return None
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec) or None


def _numbers(message: Any, prefix: str, depth: int = 0) -> Iterator[tuple[str, float]]:  # noqa: ANN401
    """Yield the numeric fields of a message; of arrays the first elements."""
    for item in fields(message):
        value, name = getattr(message, item.name), f"{prefix}{item.name}"
        if item.name in {"header", "stamp"} or name.startswith("_"):
            continue
        if isinstance(value, (bool, int, float, np.number)):
            yield name, float(value)
        elif isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "fiub":
            yield from ((f"{name}[{i}]", float(v)) for i, v in enumerate(value[:_ELEMENTS]))
        elif is_dataclass(value) and depth < _MOST_DEPTH:
            yield from _numbers(value, f"{name}.", depth + 1)
