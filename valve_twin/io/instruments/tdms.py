# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read TDMS files of LabVIEW and DIAdem by npTDMS."""

from __future__ import annotations

import re
import struct
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from valve_twin.io.errors import BagError
from valve_twin.io.instruments.cells import RawColumn, Sheet
from valve_twin.io.instruments.clock import with_clock
from valve_twin.io.instruments.table import Column, Recording, check_size, load_package, unique

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from valve_twin.io.instruments.clock import ClockChoice

_LEAD_IN = struct.Struct("<4sIIQQ")  # tag, contents, version, bytes to the next one, of metadata
_UNKNOWN = 2**64 - 1  # of bytes to the next one: the last segment goes on to the end of the file
_HAS_METADATA, _NEW_LIST = 2, 4  # bits of the contents
_NUMBERS = "fiuM"  # kinds of numpy
_OBJECT = re.compile(rb"/'(?:[^']|'')*'(?:/'(?:[^']|'')*')?")  # a path in metadata
_MOST_PLACES = 20_000_000  # objects of all segments, each of which npTDMS looks at in Python


def read_tdms(path: Path, choice: ClockChoice) -> Recording:
    """Return the channels of a TDMS file with the times of their waveforms.

    Parameters
    ----------
    path : path
        The file. Channels without a waveform take the time channel of their group, or are counted.
    choice : ClockChoice
        What is known of the time.

    Raises
    ------
    BagError
        If it is no whole TDMS file, too large, or holds no channel of numbers.
    """
    nptdms = load_package("nptdms", path)
    try:
        odd = _check_segments(path)
        with path.open("rb") as raw, nptdms.TdmsFile.open(raw) as file:
            every = [c for g in file.groups() for c in g.channels()]
            channels = [c for c in every if len(c) > 1]
            odd = (*odd, *_untaken(path, every))
            check_size(path, 8 * sum(len(c) for c in channels))
            numeric = [c for c in channels if c.dtype is not None and c.dtype.kind in _NUMBERS]
            read = [(c, np.asarray(c[:])) for c in numeric]
            waves = [(c, v) for c, v in read if c.properties.get("wf_increment")]
            if waves:
                found = _waveforms(path, waves)
                timed = {c.path for c, _ in waves}
                other = _left_out(path, read, timed, "has no times of a waveform")
                return replace(found, notices=(*odd, *other))
            columns, taken = _table(read)
            other = _left_out(path, read, taken, "is of another length")
            told = [*odd, *other]
            sheet = Sheet(path, np.arange(0, dtype=np.int64), columns, (), told, named=True)
    except BagError:
        raise
    except Exception as err:  # whatever a broken file makes the reader raise
        msg = f"{path}: is no whole TDMS file ({type(err).__name__}: {err}); export it anew"
        raise BagError(msg) from err
    if not sheet.columns:
        msg = f"{path}: holds no channel of numbers"
        raise BagError(msg)
    rows = np.arange(1, len(sheet.columns[0].values) + 1, dtype=np.int64)
    return with_clock(replace(sheet, lines=rows), choice)


def _check_segments(path: Path) -> tuple[str, ...]:
    """Refuse a file whose segments, which may be empty, take longer to look at than their data.

    Returns a notice where the last one does not end with the file: values may be others' bytes.
    """
    begin, at, places, listed = 0, 0, 0, set[bytes]()
    size = path.stat().st_size
    with path.open("rb") as raw:
        while len(head := raw.read(_LEAD_IN.size)) == _LEAD_IN.size:
            tag, contents, _, bytes_on, metadata = _LEAD_IN.unpack(head)
            if not tag.startswith(b"TDS"):
                break
            if contents & _HAS_METADATA:
                found = set(_OBJECT.findall(raw.read(min(metadata, bytes_on))))
                listed = found if contents & _NEW_LIST else listed | found
            places += len(listed)
            if places > _MOST_PLACES:
                msg = (
                    f"{path}: holds too many segments for {len(listed)} channels: defragment it "
                    "(TDMS Defragment of LabVIEW) or export it anew"
                )
                raise BagError(msg)
            begin, at = at, at + _LEAD_IN.size + bytes_on
            if at > size:  # its writer was killed, or did not know how long it would be
                at = size if bytes_on == _UNKNOWN else at
                break
            raw.seek(at)
    if at == size:
        return ()
    return (
        f"{path}: segments end at byte {at}, the file at {size}: bytes are missing or too many, "
        f"values of the segment at byte {begin} may be wrong",
    )


def _untaken(path: Path, channels: list[Any]) -> Iterator[str]:
    """Yield a notice for each channel that holds no numbers, and for values of no channel."""
    for c in channels:
        if not len(c):
            yield f"{path}: channel '{c.name}' holds no values"
        elif c.dtype is None or c.dtype.kind not in _NUMBERS:
            yield f"{path}: channel '{c.name}' holds no numbers ({c.dtype}) and is left out"
        elif _stated(c) != "" and not _unit(c):
            yield f"{path}: the unit of channel '{c.name}' is no text and is left out"
    known = {c.path for c in channels}
    with path.open("rb") as raw:
        reader = load_package("nptdms.reader", path).TdmsReader(raw)
        reader.read_metadata()
        for name, held in reader.object_metadata.items():  # npTDMS passes over a broken name
            if held.num_values and name not in known:
                yield (
                    f"{path}: {name} holds {held.num_values} values, and its name is damaged: it "
                    "is left out"
                )


def _left_out(
    path: Path, read: list[tuple[Any, Any]], taken: set[str], why: str
) -> tuple[str, ...]:
    """Return a notice for each channel of numbers that is not taken."""
    return tuple(
        f"{path}: channel '{c.name}' with {len(v)} values is left out: it {why}"
        for c, v in read
        if c.path not in taken
    )


def _waveforms(path: Path, waves: list[tuple[Any, Any]]) -> Recording:
    starts = [_start_ns(c) for c, _ in waves]
    known = [s for s in starts if s is not None]
    first = min(known) if known else None
    columns = []
    for (channel, values), start in zip(waves, starts, strict=True):
        offset = float(channel.properties.get("wf_start_offset", 0.0))
        late = 0.0 if start is None or first is None else (start - first) * 1e-9
        step = float(channel.properties["wf_increment"])
        seconds = late + offset + step * np.arange(len(values), dtype=np.float64)
        columns.append(Column(channel.name, _unit(channel), seconds, values.astype(np.float64)))
    return Recording(path, unique(columns), "increments of the waveforms", measured=True,
                     start_ns=first)  # fmt: skip


def _table(read: list[tuple[Any, Any]]) -> tuple[list[RawColumn], set[str]]:
    """Return the channels of the length that most values have, and their paths in the file."""
    lengths = [len(v) for _, v in read]
    count = max(set(lengths), key=lambda n: lengths.count(n) * n) if lengths else 0
    columns, taken = [], set()
    for channel, values in read:
        if len(values) != count:
            continue
        taken.add(channel.path)
        dated = values.dtype.kind == "M"
        numbers = values.astype("datetime64[ns]").astype(np.int64) * 1e-9 if dated else values
        unit = "s" if dated else _unit(channel)
        columns.append(RawColumn(channel.name, unit, numbers.astype(np.float64), dated, dated))
    return columns, taken


def _unit(channel: Any) -> str:  # noqa: ANN401  npTDMS has no types
    """Return the unit of a channel, empty where none is stated or what stands there is no text."""
    unit = _stated(channel)
    return unit if isinstance(unit, str) and unit.isprintable() else ""


def _stated(channel: Any) -> object:  # noqa: ANN401  npTDMS has no types
    own = channel.properties
    return own.get("unit_string", own.get("NI_UnitDescription", ""))


def _start_ns(channel: Any) -> int | None:  # noqa: ANN401  npTDMS has no types
    start = channel.properties.get("wf_start_time")
    if start is None:
        return None
    stamp = int(np.datetime64(start, "ns").astype(np.int64))
    return stamp if stamp > 0 else None
