# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What an MCAP file says about itself, and whether its records agree."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

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

if TYPE_CHECKING:
    import mmap
    from collections.abc import Iterator

_SUM = struct.Struct("<I")


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
        if op == Op.SCHEMA:
            schema = Schema.read(Body(body))
            self.schemas[schema.id] = schema
        elif op == Op.CHANNEL:
            channel = Channel.read(Body(body))
            self.channels[channel.id] = channel
        elif op == Op.CHUNK_INDEX:
            self.chunks.append(read_chunk_index(body))
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


def contradiction(data: mmap.mmap, summary: Summary) -> str:
    """Return where a summary and the records of its file disagree, empty where nowhere.

    Only the heads of the records are read.
    """
    stats = summary.statistics
    if stats is not None and stats.counts and sum(stats.counts.values()) != stats.message_count:
        return "its counts do not add up"
    chunks = {c.offset: c.length for c in summary.chunks}
    at, end = len(MAGIC), len(data) - len(MAGIC)
    messages = 0
    while at + RECORD_HEAD.size <= end:
        op, length = RECORD_HEAD.unpack_from(data, at)
        stop = at + RECORD_HEAD.size + length
        if stop > end or (not 0 < op <= Op.DATA_END and op < 0x80):
            return f"no record begins at byte {at}"
        if op == Op.CHUNK and chunks.pop(at, None) != stop - at:
            return f"it does not know the chunk at byte {at}"
        messages += op == Op.MESSAGE
        if op == Op.DATA_END:
            break
        at = stop
    if chunks:
        return f"there is no chunk at byte {min(chunks)}"
    if stats is not None and not summary.chunks and messages != stats.message_count:
        return f"it counts {stats.message_count} messages, the file holds {messages}"
    return ""


def data_sum_is_right(data: mmap.mmap, begin: int) -> bool:
    """Return whether a check sum of the whole data section stands before a place and is right."""
    at = begin - RECORD_HEAD.size - _SUM.size
    if at < len(MAGIC) or RECORD_HEAD.unpack_from(data, at) != (Op.DATA_END, _SUM.size):
        return False
    (crc,) = _SUM.unpack_from(data, at + RECORD_HEAD.size)
    return bool(crc) and zlib.crc32(data[:at]) == crc
