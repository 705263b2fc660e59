# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read MDF files (.mf4, .mdf, .dat) of measurement systems by asammdf."""

from __future__ import annotations

import re
import struct
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
from valve_twin.io.instruments.units import known_unit

if TYPE_CHECKING:
    from pathlib import Path


_CHANNEL = re.compile(rb"##CN\0{4}.{2}\0{6}\x08\0{7}", re.DOTALL)  # a block of 8 links

_LEADS_TO = (
    {b"CN"},
    {b"CN", b"CA", b"DS", b"CL", b"CV", b"CU"},
    {b"TX"},
    {b"SI"},
    {b"CC"},
    {b"SD", b"DZ", b"DL", b"HL", b"LD", b"DV", b"CG", b"AT", b"EV"},
    {b"TX", b"MD"},
    {b"TX", b"MD"},
)
"""Blocks for the links of a channel: next, parts, name, source, conversion, data, unit, note."""

_VIRTUAL = 3  # type of a channel that stands for the number of its row, as the master of a group
_OVER = {2: "an angle", 3: "a distance", 4: "an index"}
"""What rows stand over, by the kind of their group's master, if not over time."""

_COUNTED = (_VIRTUAL, 6)  # and such as others are


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
            reached = {int(c.address) for g in file.groups for c in g.channels if _has_place(c)}
            notices = _unreached(path, reached)
            notices += _timeless(path, file, sorted({g for g, _ in places}))
            notices += _over_others(path, file, sorted({g for g, _ in places}))
            columns, empty, short = [], [], []
            for g, i in places:
                signal = file.get(group=g, index=i)
                group = file.groups[g]
                if len(signal.samples) < 2 <= group.channel_group.cycles_nr or _is_void(
                    group.channels[i]
                ):
                    empty.append(str(signal.name))
                elif len(signal.samples) < 2:
                    short.append(str(signal.name))
                column = _column(signal, path, notices)
                columns += [] if column is None else [column]
            notices += _without_values(path, empty, "lack the values that their groups claim")
            notices += _without_values(path, short, "have fewer than two values")
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


def _has_place(channel: Any) -> bool:  # noqa: ANN401  of asammdf
    """Return whether a channel says where its block lies in the file."""
    return bool(getattr(channel, "address", 0))


def _unreached(path: Path, reached: set[int]) -> list[str]:
    """Say where the links of a file of version 4 do not lead to its channels or their parts."""
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as whole:
        if not whole[8:10].startswith(b"4."):
            return []
        found = [m.start() for m in _CHANNEL.finditer(whole) if m.start() % 8 == 0]
        astray = sum(_is_astray(whole, at) for at in {*found, *reached})
    lines = []
    lost = [at for at in found if at not in reached]
    if lost:
        held = len(reached) + len(lost)
        lines.append(f"of {held} channels that it holds its links lead to {len(reached)}")
    if astray:
        lines.append(f"links of {astray} channels, such as to their units, lead to other blocks")
    return [f"{path}: {line}; export it anew" for line in lines]


def _is_astray(whole: mmap, at: int) -> bool:
    """Return whether a link of the channel at a place [B] leads to a block of another kind."""
    if at + 88 > len(whole):
        return False
    count, *links = struct.unpack_from("<9Q", whole, at + 16)
    return count < len(_LEADS_TO) or any(
        link and (whole[link : link + 2] != b"##" or whole[link + 2 : link + 4] not in kinds)
        for link, kinds in zip(links, _LEADS_TO, strict=False)
    )


def _is_void(channel: Any) -> bool:  # noqa: ANN401  of asammdf
    """Return whether a channel that is not counted has no bits in a record: all zeros are read."""
    return not channel.bit_count and getattr(channel, "channel_type", 0) not in _COUNTED


def _timeless(path: Path, file: Any, groups: list[int]) -> list[str]:  # noqa: ANN401  an MDF of asammdf
    """Say of which groups the times are the numbers of their rows, for want of others."""
    counted = []
    for g in groups:
        channels, master = file.groups[g].channels, file.masters_db.get(g)
        virtual = master is not None and getattr(channels[master], "channel_type", 0) == _VIRTUAL
        if master is None or (virtual and channels[master].conversion is None):
            counted += [str(c.name) for n, c in enumerate(channels) if n != master]
    shown = ", ".join(counted[:6]) + (" ..." if len(counted) > 6 else "")
    told = f"{path}: {len(counted)} channels have no times, their rows count as seconds: {shown}"
    return [told] if counted else []


def _over_others(path: Path, file: Any, groups: list[int]) -> list[str]:  # noqa: ANN401  an MDF of asammdf
    """Say of which groups the times are something else, such as an angle, or of another unit."""
    found: dict[str, list[str]] = {}
    for g in groups:
        channels, master = file.groups[g].channels, file.masters_db.get(g)
        if master is None:
            continue
        kind = _OVER.get(getattr(channels[master], "sync_type", 0), "")
        symbol = str(channels[master].unit or "").strip()
        unit = known_unit(symbol)
        if kind or (unit and (unit.quantity, unit.size) != ("time", 1.0)):
            names = found.setdefault(" ".join(filter(None, (kind, symbol and f"[{symbol}]"))), [])
            names += [str(c.name) for n, c in enumerate(channels) if n != master]
    return [
        line
        for over, names in found.items()
        for line in _without_values(path, names, f"stand over {over}, which counts as seconds")
    ]


def _without_values(path: Path, names: list[str], why: str) -> list[str]:
    """Say which channels hold no series."""
    shown = ", ".join(names[:6]) + (" ..." if len(names) > 6 else "")
    return [f"{path}: {len(names)} channels {why}: {shown}"] if names else []


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
