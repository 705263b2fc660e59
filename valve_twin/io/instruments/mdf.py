# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read MDF files (.mf4, .mdf, .dat) of measurement systems by asammdf."""

from __future__ import annotations

import re
from contextlib import suppress
from mmap import ACCESS_READ, mmap
from typing import TYPE_CHECKING, Any

import numpy as np

from valve_twin.io.errors import BagError
from valve_twin.io.instruments.table import (
    Column,
    Recording,
    check_count,
    check_size,
    load_package,
    rising,
    unique,
    wild_row,
)

if TYPE_CHECKING:
    from pathlib import Path


_CHANNEL = re.compile(rb"##CN\0{4}.{2}\0{6}\x08\0{7}", re.DOTALL)  # a block of 8 links


def read_mdf(path: Path) -> Recording:
    """Return the channels of an MDF file, each with the times of its group.

    Parameters
    ----------
    path : path
        The file.

    Raises
    ------
    BagError
        If it is no whole MDF file, too large, or holds no channel of numbers.
    """
    asammdf = load_package("asammdf", path)
    _close_quietly()
    try:
        with asammdf.MDF(path) as file:
            places = [
                (g, c)
                for g, group in enumerate(file.groups)
                for c in range(len(group.channels))
                if file.masters_db.get(g) != c
            ]
            check_size(path, sum(8 * file.groups[g].channel_group.cycles_nr for g, _ in places))
            check_count(path, len(places))
            notices = _unreached(path, sum(len(group.channels) for group in file.groups))
            columns, empty = [], []
            for g, i in places:
                signal = file.get(group=g, index=i)
                if len(signal.samples) < 2 <= file.groups[g].channel_group.cycles_nr:
                    empty.append(str(signal.name))
                column = _column(signal, path, notices)
                columns += [] if column is None else [column]
            notices += _without_values(path, empty)
            start = file.header.start_time
            start_ns = round(start.timestamp() * 1e6) * 1000
    except BagError:
        raise
    except Exception as err:  # whatever a broken file makes the reader raise
        msg = f"{path}: is no whole MDF file ({type(err).__name__}: {err}); export it anew"
        raise BagError(msg) from err
    if not columns:
        msg = f"{path}: holds no channel of numbers"
        raise BagError(msg)
    first = min(float(c.seconds[0]) for c in columns)
    moved = [Column(c.name, c.unit, c.seconds - first, c.values) for c in columns]
    dated = start_ns + round(first * 1e9) if start_ns > 0 else None
    return Recording(path, unique(moved), "master channels", measured=True, start_ns=dated,
                     notices=tuple(notices))  # fmt: skip


def _unreached(path: Path, count: int) -> list[str]:
    """Say that more channels stand in a file of version 4 than its links lead to."""
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as whole:
        if not whole[8:10].startswith(b"4."):
            return []
        found = sum(m.start() % 8 == 0 for m in _CHANNEL.finditer(whole))
    return (
        [f"{path}: of {found} channels that it holds its links lead to {count}; export it anew"]
        if found > count
        else []
    )


def _without_values(path: Path, names: list[str]) -> list[str]:
    """Say which channels hold none of the values that their groups claim."""
    shown = ", ".join(names[:6]) + (" ..." if len(names) > 6 else "")
    told = f"{path}: {len(names)} channels lack the values that their groups claim: {shown}"
    return [told] if names else []


def _close_quietly() -> None:
    """Let the reader of a broken file be thrown away: it closes what it never opened."""
    from asammdf.blocks import mdf_v3, mdf_v4

    def forget(reader: Any) -> None:  # noqa: ANN401  of either class
        with suppress(Exception):
            reader.close()

    for reader in (mdf_v3.MDF3, mdf_v4.MDF4):
        reader.__del__ = forget  # type: ignore[method-assign]


def _column(signal: Any, path: Path, notices: list[str]) -> Column | None:  # noqa: ANN401  a Signal of asammdf
    values, times = np.asarray(signal.samples), np.asarray(signal.timestamps, dtype=np.float64)
    if values.ndim != 1 or values.dtype.kind not in "fiub" or len(values) < 2:
        return None
    keep = rising(times)
    if not keep.all():
        notices.append(f"{path}: channel '{signal.name}': time {wild_row(times, keep)}")
    numbers = values.astype(np.float64)[keep]
    return Column(str(signal.name), str(signal.unit or ""), times[keep], numbers)
