# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Records of the MCAP file format (mcap.dev/spec) that reader and writer share.

The formats are those of `mcap.records`; what stands in the way of every message or chunk is packed
here.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from io import BytesIO
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import McapRecord
from mcap.records import Statistics as StatisticsRecord

if TYPE_CHECKING:
    from collections.abc import Mapping

ByteTable = np.ndarray[tuple[int, int], np.dtype[np.uint8]]
"""One row a message, one column a byte."""

Op = Opcode
MAGIC = b"\x89MCAP0\r\n"
MESSAGE_HEAD = struct.Struct("<BQHIQQ")
"""Opcode, length of what follows, channel, sequence, log time, publish time; then the data."""

RECORD_HEAD = struct.Struct("<BQ")
_INDEX_HEAD, _INDEX_ENTRY = struct.Struct("<QQQQI"), struct.Struct("<HQ")
_COMPRESSIONS = {b"zstd": "zstd", b"lz4": "lz4"}
_INDEX_MIDDLE, _INDEX_TAIL = struct.Struct("<QI"), struct.Struct("<QQ")
FOOTER_SIZE = RECORD_HEAD.size + 20 + len(MAGIC)


class ChunkIndex(NamedTuple):
    """Where a chunk lies and what it holds; times in ns, offsets and sizes in bytes."""

    start_ns: int
    end_ns: int
    offset: int
    length: int
    message_indexes: Mapping[int, int]
    index_length: int
    compression: str
    compressed_size: int
    size: int

    @property
    def index_at(self) -> int:
        """Where the message indexes behind the chunk begin [B]."""
        return self.offset + self.length


@dataclass(slots=True)
class Statistics:
    """Counts of a file."""

    message_count: int = 0
    start_ns: int = 0
    end_ns: int = 0
    chunk_count: int = 0
    counts: dict[int, int] = field(default_factory=dict)


def record(op: Op, body: bytes) -> bytes:
    """Return a record."""
    return RECORD_HEAD.pack(op, len(body)) + body


def packed(*records: McapRecord) -> bytes:
    """Return records one after another."""
    builder = RecordBuilder()
    for one in records:
        one.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def chunk_index_record(chunk: ChunkIndex) -> bytes:
    """Return the record of a chunk index."""
    offsets = b"".join(_INDEX_ENTRY.pack(*item) for item in chunk.message_indexes.items())
    body = _INDEX_HEAD.pack(chunk.start_ns, chunk.end_ns, chunk.offset, chunk.length, len(offsets))
    name = chunk.compression.encode()
    body += offsets + _INDEX_MIDDLE.pack(chunk.index_length, len(name)) + name
    return record(Op.CHUNK_INDEX, body + _INDEX_TAIL.pack(chunk.compressed_size, chunk.size))


class Body(ReadDataStream):
    """Fields of the body of a record; struct.error where it ends too early."""

    def __init__(self, data: bytes) -> None:
        super().__init__(BytesIO(data))

    def read(self, length: int) -> bytes:
        """Read bytes."""
        data = self._stream.read(length)
        self._count += len(data)
        if len(data) < length:
            message = "record ends too early"
            raise struct.error(message)
        return data

    def read_prefixed_string(self) -> str:
        """Read a text."""
        return self.read(self.read4()).decode(errors="replace")


def read_chunk_index(data: bytes) -> ChunkIndex:
    """Read the body of a chunk index record."""
    start, end, offset, length, size = _INDEX_HEAD.unpack_from(data)
    at = _INDEX_HEAD.size + size
    offsets = dict(_INDEX_ENTRY.iter_unpack(data[_INDEX_HEAD.size : at]))
    index_length, named = _INDEX_MIDDLE.unpack_from(data, at)
    at += _INDEX_MIDDLE.size + named
    compressed, size = _INDEX_TAIL.unpack_from(data, at)
    name = data[at - named : at]
    compression = _COMPRESSIONS.get(name) or name.decode(errors="replace")
    return ChunkIndex(
        start, end, offset, length, offsets, index_length, compression, compressed, size
    )


def read_statistics(data: bytes) -> Statistics:
    """Read the body of a statistics record."""
    s = StatisticsRecord.read(Body(data))
    return Statistics(
        s.message_count,
        s.message_start_time,
        s.message_end_time,
        s.chunk_count,
        s.channel_message_counts,
    )
