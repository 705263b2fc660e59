# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Believe only plausible messages where no check sum stands for them.

A message has to be of a known topic, decode whole with its definition, lie in the time of its
chunk, and not contradict the index records behind the chunk.
"""

from __future__ import annotations

import math
import struct
from bisect import bisect_right
from dataclasses import dataclass, field, is_dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.io.cdr.bag_types import BagTypes
from valve_twin.io.cdr.signals import STAMPED_TYPE
from valve_twin.io.errors import BagError
from valve_twin.io.mcap.format import MESSAGE_HEAD, RECORD_HEAD, Op
from valve_twin.io.mcap.index_check import DEFINITIONS
from valve_twin.io.salvage.records import is_whole, next_record, record_end

if TYPE_CHECKING:
    from collections.abc import Mapping

    from mcap.records import Channel, Schema

    from valve_twin.io.cdr.message_types import Message
    from valve_twin.io.salvage.records import Bytes

_INDEX_HEAD = struct.Struct("<HI")
_ENTRY = struct.Struct("<QQ")
_FRAME_AT, _FRAME = 12, 16
_DOUBLE = struct.Struct("<d")


@dataclass(slots=True)
class Places:
    """What the index records behind a chunk say.

    Attributes
    ----------
    counts : dict
        Messages by channel.
    entries : dict
        Channel and log time [ns] by offset in the chunk.
    """

    counts: dict[int, int] = field(default_factory=dict)
    entries: dict[int, tuple[int, int]] = field(default_factory=dict)

    @classmethod
    def read(cls, data: Bytes, index: Mapping[int, int], end: int) -> Places:
        """Read index records by the places of their channels; leave out what is damaged.

        Parameters
        ----------
        data : bytes
            The file.
        index : mapping
            Where the index of each channel lies [B].
        end : int
            Where the bytes end [B].
        """
        found = cls()
        for channel, at in index.items():
            if record_end(data, at, end) is None or data[at] != Op.MESSAGE_INDEX:
                continue
            begin = at + RECORD_HEAD.size
            number, size = _INDEX_HEAD.unpack_from(data, begin)
            if number != channel or size % _ENTRY.size:
                continue
            body = data[begin + _INDEX_HEAD.size : begin + _INDEX_HEAD.size + size]
            for log_ns, offset in _ENTRY.iter_unpack(body):
                found.entries[offset] = (channel, log_ns)
            found.counts[channel] = size // _ENTRY.size
        return found

    def lie_about(self, records: bytes) -> bool:
        """Return whether more than one entry denies a whole chunk: no damage does that."""
        wrong = 0
        for at, stated in self.entries.items():
            end = record_end(records, at, len(records)) if at < len(records) else None
            if end is None or records[at] != Op.MESSAGE:
                wrong += 1
            else:
                _, _, channel, _, log_ns, _ = MESSAGE_HEAD.unpack_from(records, at)
                wrong += (channel, log_ns) != stated
        return wrong > 1


class Checks:
    """Decides whether a message can be one of its topic.

    Parameters
    ----------
    schemas : dict
        Copies of each definition by number, the best first; a better one is moved to the front.
    channels : dict
        Topics by number.
    where : str
        File for messages.
    """

    def __init__(
        self, schemas: dict[int, list[Schema]], channels: dict[int, Channel], where: str
    ) -> None:
        self._schemas, self._channels, self._where = schemas, channels, where
        self._types: dict[int, BagTypes | None] = {}
        self.suspects = 0

    def accepts(self, channel: int, data: bytes) -> bool:
        """Return whether a message decodes whole; count it where a value is not finite."""
        known = self._channels.get(channel)
        if known is None:
            return False
        if known.message_encoding != "cdr":
            return True
        if len(data) < 4 or data[0] or data[1] > 1:
            return False
        if channel not in self._types:
            self._types[channel] = self._read_types(known)
        types = self._types[channel]
        if types is None or self._decodes(types, data):
            return True
        better = self._read_types(known, after=types)
        if better is None or not self._decodes(better, data):
            return False
        self._types[channel] = better
        return True

    def _decodes(self, types: BagTypes, data: bytes) -> bool:
        if types.name == STAMPED_TYPE and data[1] == 1:
            return self._accepts_stamped(data)
        try:
            decoded = types.decode(data, 0)
        except (BagError, UnicodeDecodeError, MemoryError, OverflowError):
            return False
        self.suspects += not _finite(decoded)
        return True

    def _accepts_stamped(self, data: bytes) -> bool:
        if len(data) < _FRAME:
            return False
        (named,) = struct.unpack_from("<I", data, _FRAME_AT)
        body = 12 + named
        if len(data) != 4 + body + -body % 8 + _DOUBLE.size or (
            named and data[3 + _FRAME_AT - 12 + body]
        ):
            return False
        self.suspects += not math.isfinite(_DOUBLE.unpack_from(data, len(data) - 8)[0])
        return True

    def _read_types(self, channel: Channel, after: BagTypes | None = None) -> BagTypes | None:
        """Return the first copy of the definition that can be read, or the first other one."""
        copies = self._schemas.get(channel.schema_id, [])
        for schema in copies[1:] if after is not None else copies:
            try:
                types = BagTypes(schema, self._where)
            except BagError:
                continue
            copies.remove(schema)
            copies.insert(0, schema)
            return types
        return None


def _finite(value: Message) -> bool:
    """Return whether all numbers in a message are finite."""
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, np.ndarray):
        return value.dtype.kind != "f" or bool(np.isfinite(value).all())
    if isinstance(value, list):
        return all(map(_finite, value))
    if is_dataclass(value):
        return all(_finite(getattr(value, name)) for name in value.__dataclass_fields__)
    return True


class _Seen(NamedTuple):
    begin: int
    end: int
    channel: int
    log_ns: int


def plausible(
    records: bytes, checks: Checks, places: Places, span: tuple[int, int] | None
) -> bytes:
    """Return the records without those messages that cannot be believed.

    Parameters
    ----------
    records : bytes
        Records of a chunk, perhaps torn.
    checks : Checks
        Knows the topics.
    places : Places
        What the index says; empty where there is none.
    span : (int, int) or None
        First and last log time that the chunk claims [ns].
    """
    seen, others = _all_records(records, places)
    good = [m for m in seen if checks.accepts(m.channel, records[m.begin + 31 : m.end])]
    if span is not None:
        inside = [
            m
            for m in good
            if span[0] <= m.log_ns <= span[1]
            or places.entries.get(m.begin) == (m.channel, m.log_ns)
        ]
        if 2 * len(inside) >= len(good):
            good = inside
    wrong = _contradicted(good, places)
    kept = sorted(others + [(m.begin, m.end) for m in good if m.begin not in wrong])
    if sum(end - begin for begin, end in kept) == len(records):
        return records
    return b"".join(records[begin:end] for begin, end in kept)


def _all_records(records: bytes, places: Places) -> tuple[list[_Seen], list[tuple[int, int]]]:
    """Return messages and places of other records; look for the next after each that is torn."""
    seen: list[_Seen] = []
    others: list[tuple[int, int]] = []
    starts = sorted(places.entries)
    size = len(records)
    at: int | None = 0
    while at is not None and at < size:
        end = record_end(records, at, size)
        if end is None or not (end in places.entries or is_whole(records, at, end, size)):
            at = _next_start(records, at, starts)
            continue
        if records[at] == Op.MESSAGE:
            _, _, channel, _, log_ns, _ = MESSAGE_HEAD.unpack_from(records, at)
            seen.append(_Seen(at, end, channel, log_ns))
        else:
            others.append((at, end))
        at = end
    return seen, others


def _next_start(records: bytes, at: int, starts: list[int]) -> int | None:
    """Return where to go on behind a torn record: as the index says, if a record is there."""
    size = len(records)
    found = next_record(records, at + 1, size, kinds=_KINDS)
    later = bisect_right(starts, at)
    for start in starts[later : later + 2]:
        if found is not None and found <= start:
            return found
        if start < size and records[start] == Op.MESSAGE and record_end(records, start, size):
            return start
    return found


_KINDS = DEFINITIONS | {int(Op.MESSAGE)}


def _contradicted(seen: list[_Seen], places: Places) -> set[int]:
    """Return where a message denies its index record while all its neighbours agree with it."""
    against: dict[int, list[int]] = {}
    for message in seen:
        entry = places.entries.get(message.begin)
        if entry is not None and entry[0] != message.channel:
            against.setdefault(entry[0], []).append(message.begin)
    return {
        found[0]
        for channel, found in against.items()
        if len(found) == 1 and places.counts.get(channel, 0) > 1
    }
