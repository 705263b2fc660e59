# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Records of the MCAP file format (mcap.dev/spec) that reader and writer share."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

ByteTable = np.ndarray[tuple[int, int], np.dtype[np.uint8]]
"""One row a message, one column a byte."""

MAGIC = b"\x89MCAP0\r\n"
MESSAGE_HEAD = struct.Struct("<BQHIQQ")
"""Opcode, length of what follows, channel, sequence, log time, publish time; then the data."""

RECORD_HEAD = struct.Struct("<BQ")
_INDEX_HEAD, _INDEX_ENTRY = struct.Struct("<QQQQI"), struct.Struct("<HQ")
_INDEX_MIDDLE, _INDEX_TAIL = struct.Struct("<QI"), struct.Struct("<QQ")
FOOTER_SIZE = RECORD_HEAD.size + 20 + len(MAGIC)


class Op(IntEnum):
    """Record types."""

    HEADER = 0x01
    FOOTER = 0x02
    SCHEMA = 0x03
    CHANNEL = 0x04
    MESSAGE = 0x05
    CHUNK = 0x06
    MESSAGE_INDEX = 0x07
    CHUNK_INDEX = 0x08
    STATISTICS = 0x0B
    METADATA = 0x0C
    METADATA_INDEX = 0x0D
    SUMMARY_OFFSET = 0x0E
    DATA_END = 0x0F


@dataclass(frozen=True, slots=True)
class Schema:
    """Definition of a message type."""

    id: int
    name: str
    encoding: str
    data: bytes


@dataclass(frozen=True, slots=True)
class Channel:
    """A topic with its type."""

    id: int
    schema_id: int
    topic: str
    encoding: str
    metadata: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class ChunkIndex:
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


def text(value: str) -> bytes:
    """Return a text with its length before it."""
    data = value.encode()
    return struct.pack("<I", len(data)) + data


def text_map(values: Mapping[str, str]) -> bytes:
    """Return a map of texts."""
    data = b"".join(text(key) + text(value) for key, value in values.items())
    return struct.pack("<I", len(data)) + data


def schema_record(schema: Schema) -> bytes:
    """Return the record of a schema."""
    body = struct.pack("<H", schema.id) + text(schema.name) + text(schema.encoding)
    return record(Op.SCHEMA, body + struct.pack("<I", len(schema.data)) + schema.data)


def channel_record(channel: Channel) -> bytes:
    """Return the record of a channel."""
    body = struct.pack("<HH", channel.id, channel.schema_id) + text(channel.topic)
    return record(Op.CHANNEL, body + text(channel.encoding) + text_map(channel.metadata))


def chunk_index_record(chunk: ChunkIndex) -> bytes:
    """Return the record of a chunk index."""
    body = struct.pack("<QQQQ", chunk.start_ns, chunk.end_ns, chunk.offset, chunk.length)
    offsets = b"".join(struct.pack("<HQ", *item) for item in chunk.message_indexes.items())
    body += struct.pack("<I", len(offsets)) + offsets + struct.pack("<Q", chunk.index_length)
    body += text(chunk.compression) + struct.pack("<QQ", chunk.compressed_size, chunk.size)
    return record(Op.CHUNK_INDEX, body)


class Cursor:
    """Reads the fields of a record one after another; struct.error where it ends too early."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def take(self, layout: str) -> tuple[int, ...]:
        """Read integers."""
        values = struct.unpack_from("<" + layout, self._data, self._at)
        self._at += struct.calcsize("<" + layout)
        return values

    def raw(self, size: int) -> bytes:
        """Read bytes."""
        if self._at + size > len(self._data):
            message = "record ends too early"
            raise struct.error(message)
        part = self._data[self._at : self._at + size]
        self._at += size
        return part

    def text(self) -> str:
        """Read a text."""
        return self.raw(self.take("I")[0]).decode(errors="replace")

    def text_map(self) -> dict[str, str]:
        """Read a map of texts."""
        end = self.take("I")[0] + self._at
        values = {}
        while self._at < end:
            key = self.text()
            values[key] = self.text()
        return values

    def int_map(self) -> dict[int, int]:
        """Read a map of channel numbers to 64-bit numbers."""
        end = self.take("I")[0] + self._at
        values = {}
        while self._at < end:
            key, value = self.take("HQ")
            values[key] = value
        return values


def read_schema(data: bytes) -> Schema:
    """Read the body of a schema record."""
    cursor = Cursor(data)
    (number,) = cursor.take("H")
    name, encoding = cursor.text(), cursor.text()
    return Schema(number, name, encoding, cursor.raw(cursor.take("I")[0]))


def read_channel(data: bytes) -> Channel:
    """Read the body of a channel record."""
    cursor = Cursor(data)
    number, schema = cursor.take("HH")
    topic, encoding = cursor.text(), cursor.text()
    return Channel(number, schema, topic, encoding, cursor.text_map())


def read_chunk_index(data: bytes) -> ChunkIndex:
    """Read the body of a chunk index record."""
    start, end, offset, length, size = _INDEX_HEAD.unpack_from(data)
    at = _INDEX_HEAD.size + size
    offsets = dict(_INDEX_ENTRY.iter_unpack(data[_INDEX_HEAD.size : at]))
    index_length, named = _INDEX_MIDDLE.unpack_from(data, at)
    at += _INDEX_MIDDLE.size + named
    compressed, size = _INDEX_TAIL.unpack_from(data, at)
    compression = data[at - named : at].decode(errors="replace")
    return ChunkIndex(
        start, end, offset, length, offsets, index_length, compression, compressed, size
    )


def read_statistics(data: bytes) -> Statistics:
    """Read the body of a statistics record."""
    cursor = Cursor(data)
    messages, _, _, _, _, chunks, start, end = cursor.take("QHIIIIQQ")
    return Statistics(messages, start, end, chunks, cursor.int_map())
