# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Write one MCAP file: small zstd chunks with CRC and index, so that a power cut costs little.

Every chunk repeats the schemas and channels of its messages (a few hundred compressed bytes): each
chunk that survives a damage can be read by itself.
"""

from __future__ import annotations

import struct
from array import array
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

import numpy as np
import zstandard
from mcap.records import (
    Channel,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    SummaryOffset,
)
from mcap.records import Statistics as StatisticsRecord

from valve_twin.io.mcap.checksum import crc32
from valve_twin.io.mcap.format import (
    MAGIC,
    MESSAGE_HEAD,
    RECORD_HEAD,
    ChunkIndex,
    Op,
    Statistics,
    chunk_index_record,
    packed,
    record,
)

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import BinaryIO

    from valve_twin.core.types import IntArray
    from valve_twin.io.mcap.format import ByteTable

CHUNK_SIZE = 64 * 1024
"""Bytes in a chunk before compression: 0.5 s at 1 kHz are at stake, 1 MiB would be 11 s."""

_NEVER = 2**63 - 1
_CHUNK_HEAD, _SUM = struct.Struct("<QQQII"), struct.Struct("<I")
_MESSAGE_BODY = MESSAGE_HEAD.size - RECORD_HEAD.size


class McapWriter:
    """Writer of one file.

    Parameters
    ----------
    stream : binary file
        Open for writing; closing it is the caller's business.
    chunk_size : int
        Bytes in a chunk before compression.
    compressed : bool
        Whether chunks are compressed with zstd.
    """

    def __init__(
        self, stream: BinaryIO, *, chunk_size: int = CHUNK_SIZE, compressed: bool = True
    ) -> None:
        self._stream = stream
        self._chunk_size, self._compressed = chunk_size, compressed
        self._compressor = zstandard.ZstdCompressor(level=1)
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._chunks: list[ChunkIndex] = []
        self._described: dict[int, bytes] = {}
        self._metadata: list[MetadataIndex] = []
        self.statistics = Statistics()
        self._at = 0
        self._body = bytearray()
        self._index: dict[int, array[int]] = {}
        self._first_ns, self._last_ns = _NEVER, 0
        self._put(MAGIC + packed(Header("ros2", f"valve_twin {_version()}")))

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Add a message type and return its number.

        Parameters
        ----------
        name, encoding : str
            Full type name and kind of the definition.
        data : bytes
            The definition.
        """
        number = len(self._schemas) + 1
        self._schemas[number] = Schema(number, data, encoding, name)
        return number

    def add_channel(self, schema_id: int, topic: str, metadata: Mapping[str, str]) -> int:
        """Add a topic and return its number.

        Parameters
        ----------
        schema_id : int
            Number of its type.
        topic : str
            Absolute name.
        metadata : mapping
            What else is known of it, texts by name.
        """
        number = len(self._channels) + 1
        self._channels[number] = Channel(number, topic, "cdr", dict(metadata), schema_id)
        self.statistics.counts[number] = 0
        return number

    def write(
        self, channel: int, data: bytes, *, log_ns: int, publish_ns: int, sequence: int
    ) -> None:
        """Append a message.

        Parameters
        ----------
        channel : int
            Number of the channel.
        data : bytes
            Serialized message.
        log_ns, publish_ns : int
            Receive time and source time [ns].
        sequence : int
            Number of the message on its channel, 0 = unknown.
        """
        if channel not in self._index:
            self._describe(channel)
        self._index[channel].extend((log_ns, len(self._body)))
        self._body += MESSAGE_HEAD.pack(
            Op.MESSAGE, _MESSAGE_BODY + len(data), channel, sequence, log_ns, publish_ns
        )
        self._body += data
        self._first_ns = min(self._first_ns, log_ns)
        self._last_ns = max(self._last_ns, log_ns)
        self.statistics.counts[channel] += 1
        if len(self._body) >= self._chunk_size:
            self.end_chunk()

    def write_rows(
        self, channels: IntArray, data: ByteTable, times: IntArray, sequences: IntArray
    ) -> int:
        """Append messages of one length until a chunk is full; the same bytes as one by one.

        Parameters
        ----------
        channels : (N,) int64 array
            Number of the channel of each message.
        data : (N, S) uint8 array
            Serialized messages.
        times : (2, N) int64 array
            Receive times and source times [ns].
        sequences : (N,) int64 array
            Numbers of the messages on their channels.

        Returns
        -------
        int
            Messages that were taken, at least one of those that there are.
        """
        size = MESSAGE_HEAD.size + data.shape[1]
        limit = max(1, self._room(size))
        channels, times = channels[:limit], times[:, :limit]
        rows = _rows(channels, data[:limit], times, sequences[:limit])
        offsets = np.empty(len(channels), dtype=np.int64)
        present = np.flatnonzero(np.bincount(channels)).tolist()
        new = sorted((int((channels == c).argmax()), c) for c in present if c not in self._index)
        done, least = 0, 0
        for at, channel in [*new, (len(channels), None)]:
            count = min(at - done, max(self._room(size), least))
            begin = len(self._body)
            offsets[done : done + count] = begin + size * np.arange(count)
            self._body += rows[done * size : (done + count) * size]
            done += count
            if done < at or self._room(size) <= 0 or channel is None:
                break
            self._describe(channel)
            least = 1
        self._add_entries(channels[:done], times[0, :done], offsets[:done])
        if len(self._body) >= self._chunk_size:
            self.end_chunk()
        return done

    def _room(self, size: int) -> int:
        """Return how many messages of a size begin before the running chunk is full."""
        return -(-(self._chunk_size - len(self._body)) // size)

    def _add_entries(self, channels: IntArray, log_ns: IntArray, offsets: IntArray) -> None:
        """Note messages that stand in the running chunk."""
        entries = np.stack([log_ns, offsets], axis=1)
        for channel, index in self._index.items():
            mine = entries[channels == channel]
            if len(mine):
                index.frombytes(mine.tobytes())
                self.statistics.counts[channel] += len(mine)
        self._first_ns = min(self._first_ns, int(log_ns.min()))
        self._last_ns = max(self._last_ns, int(log_ns.max()))

    def _describe(self, channel: int) -> None:
        """Put a channel and its schema into the running chunk."""
        self._index[channel] = array("Q")
        if channel not in self._described:
            described = self._channels[channel]
            schema = self._schemas[described.schema_id]
            self._described[channel] = packed(schema, described)
        self._body += self._described[channel]

    def end_chunk(self) -> None:
        """Write the running chunk to the stream, if it holds anything."""
        if not self._body:
            return
        body = bytes(self._body)
        data = self._compressor.compress(body) if self._compressed else body
        compression = "zstd" if self._compressed else ""
        name = compression.encode()
        head = _CHUNK_HEAD.pack(self._first_ns, self._last_ns, len(body), crc32(body), len(name))
        offset = self._at
        head += name + struct.pack("<Q", len(data))
        chunk = record(Op.CHUNK, head + data)
        tail, indexes = b"", {}
        for channel, index in self._index.items():
            indexes[channel] = offset + len(chunk) + len(tail)
            entries = index.tobytes()
            head = struct.pack("<HI", channel, len(entries))
            tail += record(Op.MESSAGE_INDEX, head + entries)
        self._put(chunk + tail)
        self._chunks.append(
            ChunkIndex(
                self._first_ns,
                self._last_ns,
                offset,
                len(chunk),
                indexes,
                len(tail),
                compression,
                len(data),
                len(body),
            )
        )
        self._count_chunk()
        self._begin_chunk()

    def drop_chunk(self, at: int) -> dict[int, int]:
        """Go on at a byte offset after a failed write; return the messages lost by channel.

        The running chunk and the records at and behind the offset are forgotten; the caller cuts
        the stream there.
        """
        lost = {channel: len(entries) // 2 for channel, entries in self._index.items()}
        for channel, count in lost.items():
            self.statistics.counts[channel] -= count
        self._metadata = [m for m in self._metadata if m.offset < at]
        self._at = at
        self._begin_chunk()
        return lost

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Append a metadata record."""
        self.end_chunk()
        offset = self._at
        self._put(packed(Metadata(name, dict(values))))
        self._metadata.append(MetadataIndex(offset, self._at - offset, name))

    def finish(self) -> None:
        """Write what is left, the summary and the footer."""
        self.end_chunk()
        self._put(packed(DataEnd(0)))
        start = self._at
        groups = {
            Op.SCHEMA: packed(*self._schemas.values()),
            Op.CHANNEL: packed(*self._channels.values()),
            Op.STATISTICS: packed(self._statistics_record()),
            Op.CHUNK_INDEX: b"".join(map(chunk_index_record, self._chunks)),
            Op.METADATA_INDEX: packed(*self._metadata),
        }
        summary, offsets = b"", b""
        for op, part in groups.items():
            if part:
                offsets += packed(SummaryOffset(op, start + len(summary), len(part)))
            summary += part
        footer = packed(Footer(start, start + len(summary), 0))
        tail = summary + offsets + footer[: -_SUM.size]
        self._put(tail + _SUM.pack(crc32(tail)) + MAGIC)

    @property
    def size(self) -> int:
        """Bytes written to the stream so far [B]."""
        return self._at

    def _begin_chunk(self) -> None:
        self._body = bytearray()
        self._index = {}
        self._first_ns, self._last_ns = _NEVER, 0

    def _put(self, data: bytes) -> None:
        self._stream.write(data)
        self._at += len(data)

    def _count_chunk(self) -> None:
        counts = self.statistics
        first = counts.message_count == 0
        counts.start_ns = self._first_ns if first else min(counts.start_ns, self._first_ns)
        counts.end_ns = max(counts.end_ns, self._last_ns)
        counts.chunk_count += 1
        counts.message_count += sum(len(entries) // 2 for entries in self._index.values())

    def _statistics_record(self) -> StatisticsRecord:
        s = self.statistics
        return StatisticsRecord(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=s.counts,
            chunk_count=s.chunk_count,
            message_count=s.message_count,
            message_end_time=s.end_ns,
            message_start_time=s.start_ns,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )


def _rows(channels: IntArray, data: ByteTable, times: IntArray, sequences: IntArray) -> memoryview:
    """Return the records of messages of one length, one after another."""
    width = data.shape[1]
    kinds = ["u1", "<u8", "<u2", "<u4", "<u8", "<u8", f"V{width}"]
    names = ["op", "length", "channel", "sequence", "log", "publish", "data"]
    rows = np.empty(len(data), dtype=list(zip(names, kinds, strict=True)))
    rows["op"], rows["length"] = Op.MESSAGE, _MESSAGE_BODY + width
    rows["channel"], rows["sequence"] = channels, sequences
    rows["log"], rows["publish"] = times
    rows["data"] = data.view(f"V{width}")[:, 0]
    return rows.view(np.uint8).data


def _version() -> str:
    try:
        return version("valve_twin")
    except PackageNotFoundError:
        return "from source"
