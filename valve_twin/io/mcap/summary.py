# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What an MCAP file says about itself, and whether its records agree."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from operator import attrgetter
from typing import TYPE_CHECKING

import numpy as np
from mcap.records import Channel, Metadata, MetadataIndex, Schema

from valve_twin.io.mcap.format import (
    MAGIC,
    MESSAGE_HEAD,
    RECORD_HEAD,
    Body,
    ChunkIndex,
    Op,
    Statistics,
    read_chunk_index,
    read_statistics,
)
from valve_twin.io.mcap.index_check import DEFINITIONS, ENTRY_SIZE, INDEX_HEAD

if TYPE_CHECKING:
    import mmap
    from collections.abc import Collection, Iterator

_CHUNK_INDEX = int(Op.CHUNK_INDEX)
_NO_CHANNEL = 1 << 16
_PRIVATE = 0x80
_OFFSET = attrgetter("offset")
_NEVER = 2**64
OF_DATA = DEFINITIONS | {int(Op.MESSAGE), int(Op.ATTACHMENT), int(Op.METADATA)}
"""Records that stand in a data section beside its chunks and their indexes."""


@dataclass(slots=True)
class Summary:
    """What a file says about itself; `statistics` is None where it says nothing.

    `used` are channels of messages in chunks, as far as these were looked at.
    """

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkIndex] = field(default_factory=list)
    statistics: Statistics | None = None
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    used: set[int] = field(default_factory=set)

    def add(self, op: int, body: bytes) -> None:
        """Add a definition, index, count or metadata record."""
        if op == _CHUNK_INDEX:
            self.chunks.append(read_chunk_index(body))
        elif op == Op.SCHEMA:
            schema = Schema.read(Body(body))
            self.schemas[schema.id] = schema
        elif op == Op.CHANNEL:
            channel = Channel.read(Body(body))
            self.channels[channel.id] = channel
        elif op == Op.STATISTICS:
            self.statistics = read_statistics(body)
        elif op == Op.METADATA:
            found = Metadata.read(Body(body))
            self.metadata[found.name] = found.metadata

    def take(self, records: bytes) -> None:
        """Take the definitions of a chunk, and which channels its messages have."""
        for op, begin, end in records_of(records):
            if op in DEFINITIONS:
                self.add(op, records[begin:end])
            elif op == Op.MESSAGE:
                self.used.add(int.from_bytes(records[begin : begin + 2], "little"))

    @property
    def lacks_definitions(self) -> bool:
        """Whether it repeats no topics, or not the types of all."""
        schemas = {c.schema_id for c in self.channels.values()} - {0}
        return not self.channels or not schemas <= self.schemas.keys()

    def knows(self, record: bytes | memoryview) -> bool:
        """Return whether a definition, record head included, stands here as it is."""
        body = Body(bytes(record[RECORD_HEAD.size :]))
        if record[0] == Op.SCHEMA:
            schema = Schema.read(body)
            return bool(self.schemas.get(schema.id) == schema)
        channel = Channel.read(body)
        return bool(self.channels.get(channel.id) == channel)


class Defined:
    """Definitions of a data section that the summary knows alike.

    Parameters
    ----------
    summary : Summary, optional
        What it knows; None = it is not read yet, and nothing contradicts it.
    """

    def __init__(self, summary: Summary | None = None) -> None:
        self._summary = summary
        self._seen: set[bytes] = set()

    @property
    def channels(self) -> Collection[int] | None:
        """Channels that it knows; None = any, as it is not read yet."""
        return None if self._summary is None else self._summary.channels

    def holds(self, record: bytes) -> bool:
        """Return whether the summary knows a definition, record head included, alike."""
        if self._summary is None or record in self._seen:
            return True
        if not self._summary.knows(record):
            return False
        self._seen.add(record)
        return True

    def begins(self, records: bytes | memoryview) -> bool:
        """Return whether it knows all alike that stand before the first message of a chunk."""
        at, end = 0, len(records)
        while at + RECORD_HEAD.size <= end:
            op, length = RECORD_HEAD.unpack_from(records, at)
            stop = at + RECORD_HEAD.size + length
            if op == Op.MESSAGE or stop > end:
                return True
            if op in DEFINITIONS and not self.holds(bytes(records[at:stop])):
                return False
            at = stop
        return True


@dataclass(slots=True)
class Loose:
    """Messages outside chunks: how many of each channel, and their log times [ns]."""

    counts: Counter[int] = field(default_factory=Counter)
    start_ns: int = _NEVER
    end_ns: int = 0

    def add(self, data: mmap.mmap | memoryview, at: int) -> None:
        """Count the message at a place."""
        _, _, channel, _, log_ns, _ = MESSAGE_HEAD.unpack_from(data, at)
        self.counts[channel] += 1
        self.start_ns = min(self.start_ns, log_ns)
        self.end_ns = max(self.end_ns, log_ns)

    def statistics(self) -> Statistics:
        """Return the statistics of a file that holds just these."""
        count = self.counts.total()
        start_ns = self.start_ns if count else 0
        return Statistics(count, start_ns, self.end_ns, 0, dict(self.counts))


def records_of(data: bytes | memoryview) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, begin and end of the body of every whole record of a section."""
    at, end = 0, len(data)
    while at + RECORD_HEAD.size <= end:
        op, length = RECORD_HEAD.unpack_from(data, at)
        begin = at + RECORD_HEAD.size
        if begin + length > end:
            return
        yield op, begin, begin + length
        at = begin + length


def metadata_places(tail: bytes) -> dict[str, tuple[int, int]]:
    """Return offset and length of each metadata record that a summary names [B]."""
    places = {}
    for op, begin, end in records_of(tail):
        if op == Op.METADATA_INDEX:
            found = MetadataIndex.read(Body(tail[begin:end]))
            places[found.name] = (found.offset, found.length)
    return places


def contradiction(data: mmap.mmap, summary: Summary, end: int) -> str:
    """Return where a summary contradicts itself or the data section, empty where nowhere.

    Chunks are not looked into: head, indexes and messages are compared when they are read.

    Parameters
    ----------
    data : mmap
        The file.
    summary : Summary
        What it says about itself.
    end : int
        Where the summary begins [B].
    """
    stats = summary.statistics
    if stats is not None and stats.counts and sum(stats.counts.values()) != stats.message_count:
        return "its counts do not add up"
    loose = Loose()
    at = len(MAGIC)
    for chunk in sorted(summary.chunks, key=_OFFSET):
        if chunk.offset != at:
            problem, at = _between(data, at, min(chunk.offset, end), summary, loose)
            if problem or chunk.offset != at:
                return problem or f"the chunk at byte {chunk.offset} begins within another record"
        at += chunk.length + chunk.index_length
    problem, at = _between(data, at, end, summary, loose)
    if problem or at != end:
        return problem or f"no record begins at byte {at}"
    if summary.chunks and loose.counts:
        return "there are messages outside the chunks"
    if not summary.used | loose.counts.keys() <= summary.channels.keys():
        return "there are messages of channels that nothing defines"
    return _indexed(summary, loose)


def _between(
    data: mmap.mmap, at: int, end: int, summary: Summary, loose: Loose
) -> tuple[str, int]:
    """Walk the records between two chunks; count messages outside chunks."""
    while at < end:
        if at + RECORD_HEAD.size > end:
            return f"no record begins at byte {at}", at
        op, length = RECORD_HEAD.unpack_from(data, at)
        stop = at + RECORD_HEAD.size + length
        if stop > end or not (0 < op <= Op.DATA_END or op >= _PRIVATE):
            return f"no record begins at byte {at}", at
        if op in {Op.CHUNK, Op.MESSAGE_INDEX}:
            return f"it does not know the record at byte {at}", at
        if op == Op.MESSAGE and length >= MESSAGE_HEAD.size - RECORD_HEAD.size:
            loose.add(data, at)
        elif op in DEFINITIONS and not summary.knows(data[at:stop]):
            return f"it knows the definition at byte {at} otherwise", at
        elif not (op in OF_DATA or op >= _PRIVATE or _frames(op, at, stop, end)):
            return f"the record at byte {at} does not belong there", at
        at = stop
    return "", at


def _frames(op: int, at: int, stop: int, end: int) -> bool:
    """Return whether a record begins or ends a data section."""
    return (op == Op.HEADER and at == len(MAGIC)) or (op == Op.DATA_END and stop == end)


def _indexed(summary: Summary, loose: Loose) -> str:
    """Return where the counts disagree with the message indexes or with what is loose."""
    stats, chunks = summary.statistics, summary.chunks
    counts = loose.counts
    if chunks:
        if not all(c.message_indexes and c.index_length for c in chunks):
            return ""
        begins: list[int] = []
        channels: list[int] = []
        sizes: list[int] = []
        for chunk in chunks:
            indexes = chunk.message_indexes
            begins += indexes.values()
            channels += indexes
            begins.append(chunk.offset + chunk.length + chunk.index_length)
            channels.append(_NO_CHANNEL)
            sizes.append(chunk.index_length - INDEX_HEAD * len(indexes))
        places, channel = np.array(begins), np.array(channels)
        order = np.argsort(places, kind="stable")
        places, channel = places[order], channel[order]
        entries, rest = np.divmod(np.diff(places) - INDEX_HEAD, ENTRY_SIZE)
        mine = channel[:-1] != _NO_CHANNEL
        if (
            (entries[mine] < 0).any()
            or rest[mine].any()
            or entries[mine].sum() * ENTRY_SIZE != sum(sizes)
        ):
            return "it names message indexes where there are none"
        found = np.bincount(channel[:-1][mine], weights=entries[mine])
        counts = Counter({i: int(n) for i, n in enumerate(found.tolist()) if n})
    if not counts.keys() <= summary.channels.keys():
        return "it lacks topics that the file holds"
    if stats is None:
        return ""
    total = counts.total()
    if total != stats.message_count or (chunks and len(chunks) != stats.chunk_count):
        return f"it counts {stats.message_count} messages, the file holds {total}"
    if stats.counts and +Counter(stats.counts) != counts:
        return "it counts other messages of its topics than the file holds"
    if total:
        start = min((c.start_ns for c in chunks), default=loose.start_ns)
        span = start, max((c.end_ns for c in chunks), default=loose.end_ns)
        if start and span != (stats.start_ns, stats.end_ns):
            return "it states other times than its chunks or messages"
    return ""
