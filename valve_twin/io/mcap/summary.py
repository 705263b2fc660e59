# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What an MCAP file says about itself, and whether its records agree."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from operator import attrgetter
from typing import TYPE_CHECKING

import numpy as np
from mcap.records import Channel, Metadata, Schema

from valve_twin.io.mcap.format import (
    MAGIC,
    RECORD_HEAD,
    Body,
    ChunkIndex,
    Op,
    Statistics,
    read_chunk_index,
    read_statistics,
)
from valve_twin.io.mcap.index_check import ENTRY_SIZE, INDEX_HEAD

if TYPE_CHECKING:
    import mmap
    from collections.abc import Iterator

_CHUNK_INDEX = int(Op.CHUNK_INDEX)
_NO_CHANNEL = 1 << 16
_PRIVATE = 0x80
_OFFSET = attrgetter("offset")


@dataclass(slots=True)
class Summary:
    """What a file says about itself; `statistics` is None where it says nothing."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkIndex] = field(default_factory=list)
    statistics: Statistics | None = None
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)

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
    loose: Counter[int] = Counter()
    at = len(MAGIC)
    for chunk in sorted(summary.chunks, key=_OFFSET):
        if chunk.offset != at:
            problem, at = _between(data, at, min(chunk.offset, end), loose)
            if problem or chunk.offset != at:
                return problem or f"the chunk at byte {chunk.offset} begins within another record"
        at += chunk.length + chunk.index_length
    problem, at = _between(data, at, end, loose)
    if problem or at != end:
        return problem or f"no record begins at byte {at}"
    if summary.chunks and loose:
        return "there are messages outside the chunks"
    return _indexed(summary, loose)


def _between(data: mmap.mmap, at: int, end: int, loose: Counter[int]) -> tuple[str, int]:
    """Walk the records between two chunks; count messages outside chunks by channel."""
    while at < end:
        if at + RECORD_HEAD.size > end:
            return f"no record begins at byte {at}", at
        op, length = RECORD_HEAD.unpack_from(data, at)
        stop = at + RECORD_HEAD.size + length
        if stop > end or not (0 < op <= Op.DATA_END or op >= _PRIVATE):
            return f"no record begins at byte {at}", at
        if op in {Op.CHUNK, Op.MESSAGE_INDEX}:
            return f"it does not know the record at byte {at}", at
        if op == Op.MESSAGE:
            loose[int.from_bytes(data[at + 9 : at + 11], "little")] += 1
        at = stop
    return "", at


def _indexed(summary: Summary, loose: Counter[int]) -> str:
    """Return where the counts disagree with the message indexes or with what is loose."""
    stats, chunks = summary.statistics, summary.chunks
    counts = loose
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
    if chunks and total:
        start = min(c.start_ns for c in chunks)
        span = start, max(c.end_ns for c in chunks)
        if start and span != (stats.start_ns, stats.end_ns):
            return "it states other times than its chunks"
    return ""
