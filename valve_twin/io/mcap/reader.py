# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read one MCAP file: its summary, and its chunks decompressed and checked."""

from __future__ import annotations

import mmap
import struct
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import zstandard
from mcap.records import Metadata, MetadataIndex

from valve_twin.io.errors import BagError
from valve_twin.io.mcap.checksum import crc32
from valve_twin.io.mcap.format import (
    FOOTER_SIZE,
    MAGIC,
    MESSAGE_HEAD,
    RECORD_HEAD,
    Body,
    ChunkIndex,
    Op,
)
from valve_twin.io.mcap.summary import (
    Summary,
    contradiction,
    data_sum_is_right,
    records_of,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from valve_twin.io.mcap.damage import Salvage


_FOREIGN = {
    b"SQLite format 3": "a SQLite bag; convert it to MCAP with 'ros2 bag convert'",
    b"#ROSBAG V": "a ROS 1 bag; convert it to a ROS 2 MCAP bag with 'rosbags-convert'",
    b"\x28\xb5\x2f\xfd": "compressed as a whole file; unpack it with 'zstd -d'",
}

_MAX_CHUNK = 1 << 32
_CHUNK_HEAD = struct.Struct("<QQQII")
"""First and last log time, decompressed size, check sum, length of the compression's name."""

_LENGTH = struct.Struct("<Q")
_RECOVER = "rewrite the file with 'valve-twin recover'"
_BROKEN = (struct.error, ValueError, IndexError, OverflowError)


@dataclass(frozen=True, slots=True)
class RawMessage:
    """One message as it stands in a chunk; times in ns."""

    channel: int
    log_ns: int
    publish_ns: int
    data: bytes


class DamagedError(BagError):
    """A file is damaged; perhaps a part of it can still be read."""


class McapFile:
    """One open file.

    Parameters
    ----------
    path : path
        The file.
    salvage : callable, optional
        Gives what is intact of a damaged file; `damage` then says what is lost. Without it a
        damaged file is refused.
    salvaged : Salvage, optional
        What is intact of the file, where that is known already.

    Raises
    ------
    BagError
        If it cannot be opened, is no MCAP file or nothing in it is intact; says what to do.
    """

    def __init__(
        self,
        path: Path,
        *,
        salvage: Callable[[Path], Salvage] | None = None,
        salvaged: Salvage | None = None,
    ) -> None:
        self.path = path
        self.damage = salvaged
        self._salvage = salvage
        self._map = _open(path)
        self._view = memoryview(self._map)
        self._unpacker = zstandard.ZstdDecompressor()
        try:
            self.summary = self._read_summary() if salvaged is None else salvaged.summary
        except (*_BROKEN, DamagedError) as err:
            self.summary = self._salvaged(self._refusal(err)).summary
        self._is_salvaged = self.damage is not None

    def _refusal(self, err: Exception) -> BagError:
        if isinstance(err, BagError):
            return err
        return DamagedError(f"{self.path}: the summary is damaged ({err}); {_RECOVER}")

    def _salvaged(self, err: BagError) -> Salvage:
        """Return what is intact of the file; raise the error where nothing is."""
        found = None if self._salvage is None else self._salvage(self.path)
        if found is None or (not found.rescued and not found.summary.chunks):
            self.close()
            raise err
        self.damage = found
        return found

    def close(self) -> None:
        """Close the file; what still looks into it keeps it mapped."""
        with suppress(BufferError):
            self._view.release()
            self._map.close()

    def chunk(self, index: ChunkIndex) -> bytes:
        """Return the decompressed records of a chunk.

        Raises
        ------
        BagError
            If it is damaged or compressed in an unknown way.
        """
        return bytes(self.chunk_view(index))

    def chunk_view(self, index: ChunkIndex) -> bytes | memoryview:
        """Return the decompressed records of a chunk without a copy; valid while it is open.

        Raises
        ------
        BagError
            If it is damaged and nothing in the file is intact.
        """
        rescued = None if self.damage is None else self.damage.rescued.get(index.offset)
        if rescued is not None:
            return rescued
        try:
            return self._unpacked(index)
        except DamagedError as err:
            return self._salvaged(err).rescued.get(index.offset, b"")

    def _unpacked(self, index: ChunkIndex) -> bytes | memoryview:
        """Return the records of a chunk as it stands in the file."""
        try:
            op, length = RECORD_HEAD.unpack_from(self._view, index.offset)
            begin = index.offset + RECORD_HEAD.size
            _, _, size, crc, named = _CHUNK_HEAD.unpack_from(self._view, begin)
            at = begin + _CHUNK_HEAD.size + named
            (packed,) = _LENGTH.unpack_from(self._view, at)
        except _BROKEN as err:
            raise self._damaged(index, f"cannot be read ({err})") from err
        at += _LENGTH.size
        if op != Op.CHUNK or size > _MAX_CHUNK or at + packed > begin + length:
            raise self._damaged(index, "there is no chunk")
        name = self._view[at - _LENGTH.size - named : at - _LENGTH.size]
        data = self._decompress(bytes(name), self._view[at : at + packed], size, index)
        if len(data) != size or (crc and crc32(data) != crc):
            raise self._damaged(index, "its check sum is wrong")
        return data

    def _decompress(
        self, compression: bytes, packed: memoryview, size: int, index: ChunkIndex
    ) -> bytes | memoryview:
        try:
            if compression == b"zstd":
                return self._unpacker.decompress(packed, max_output_size=size)
            if compression == b"lz4":
                import lz4.frame

                return bytes(lz4.frame.decompress(packed))
        except (zstandard.ZstdError, RuntimeError, MemoryError) as err:
            raise self._damaged(index, f"cannot be unpacked ({err})") from err
        if compression:
            what = f"compression '{compression.decode(errors='replace')}' is unknown"
            raise self._damaged(index, what, "record with zstd, lz4 or none")
        return packed

    def _damaged(self, index: ChunkIndex, what: str, remedy: str = _RECOVER) -> DamagedError:
        return DamagedError(f"{self.path}: chunk at byte {index.offset}: {what}; {remedy}")

    def loose_messages(self) -> memoryview:
        """Return the data section of a file that has messages outside chunks."""
        if self._is_salvaged:
            return memoryview(b"")
        return self._view[len(MAGIC) :]

    def _read_summary(self) -> Summary:
        if len(self._map) < 2 * len(MAGIC) + FOOTER_SIZE or self._map[-len(MAGIC) :] != MAGIC:
            msg = (
                f"{self.path}: was cut after {len(self._map)} bytes, its recorder did not finish "
                "it; rewrite it with 'valve-twin recover'"
            )
            raise DamagedError(msg)
        if self._map[: len(MAGIC)] != MAGIC:
            msg = "the mark at its begin is wrong"
            raise ValueError(msg)
        footer = self._map[-FOOTER_SIZE : -len(MAGIC)]
        op, _ = RECORD_HEAD.unpack_from(footer)
        start, _, crc = struct.unpack_from("<QQI", footer, RECORD_HEAD.size)
        if op != Op.FOOTER:
            msg = "no footer"
            raise ValueError(msg)
        if start == 0:
            return self._scan()
        tail = self._map[start : len(self._map) - len(MAGIC)]
        if crc and crc32(tail[:-4]) != crc:
            msg = "check sum of the summary is wrong"
            raise ValueError(msg)
        summary = Summary()
        for op, begin, end in records_of(tail):
            summary.add(op, tail[begin:end])
        counted = summary.statistics
        loose = counted is not None and not counted.chunk_count
        if (not crc or loose) and not data_sum_is_right(self._map, start):
            problem = contradiction(self._map, summary)
            if problem:
                raise ValueError(problem)
        if not summary.chunks and (counted is None or counted.chunk_count):
            summary = self._scan()
            summary.statistics = counted
        for name, (offset, length) in _metadata_places(tail).items():
            body = self._map[offset + RECORD_HEAD.size : offset + length]
            found = Metadata.read(Body(body))
            summary.metadata[name] = found.metadata if found.name == name else {}
        return summary

    def _scan(self) -> Summary:
        """Read the records of the data section one by one: there is no summary."""
        summary = Summary()
        data = self._map[len(MAGIC) : -len(MAGIC)]
        for op, begin, end in records_of(data):
            body = data[begin:end]
            if op == Op.CHUNK:
                start, last, size, *_ = _CHUNK_HEAD.unpack_from(body)
                offset = len(MAGIC) + begin - RECORD_HEAD.size
                length = len(body) + RECORD_HEAD.size
                summary.chunks.append(ChunkIndex(start, last, offset, length, {}, 0, "", 0, size))
            else:
                summary.add(op, body)
        for chunk in summary.chunks:
            records = self.chunk(chunk)
            for op, begin, end in records_of(records):
                summary.add(op, records[begin:end])
        return summary


def _open(path: Path) -> mmap.mmap:
    try:
        with path.open("rb") as stream:
            head = stream.read(16)
            if not path.stat().st_size:
                msg = f"{path}: the file is empty; nothing was recorded"
                raise BagError(msg)
            data = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
    except FileNotFoundError:
        msg = f"{path}: there is no such file; give a bag folder, a metadata.yaml or an .mcap file"
        raise BagError(msg) from None
    except OSError as err:
        msg = f"{path}: cannot be read ({err.strerror}); check the path and its permissions"
        raise BagError(msg) from err
    problem = _foreign(head, data)
    if problem:
        data.close()
        msg = f"{path}: {problem}"
        raise BagError(msg)
    return data


def _foreign(head: bytes, data: mmap.mmap) -> str:
    for magic, what in _FOREIGN.items():
        if head.startswith(magic):
            return f"is no MCAP file but {what}"
    same = sum(a == b for a, b in zip(head, MAGIC, strict=False))
    if same < min(len(head), len(MAGIC)) - 1 and data[-len(MAGIC) :] != MAGIC:
        return "is no MCAP file; give a bag that a ROS 2 recorder wrote with MCAP storage"
    return ""


def _metadata_places(tail: bytes) -> dict[str, tuple[int, int]]:
    places = {}
    for op, begin, end in records_of(tail):
        if op == Op.METADATA_INDEX:
            found = MetadataIndex.read(Body(tail[begin:end]))
            places[found.name] = (found.offset, found.length)
    return places


def record_pieces(data: memoryview, size: int) -> Iterator[memoryview]:
    """Cut a long section between two records into pieces of about a size [B]."""
    at = begin = 0
    while len(data) - begin > size and at + RECORD_HEAD.size <= len(data):
        if at - begin >= size:
            yield data[begin:at]
            begin = at
        at += RECORD_HEAD.size + RECORD_HEAD.unpack_from(data, at)[1]
    yield data[begin:]


def messages(data: bytes | memoryview, channels: set[int]) -> Iterator[RawMessage]:
    """Yield the messages of some channels in a decompressed chunk, in file order."""
    at, end, head = 0, len(data), MESSAGE_HEAD.size
    while at + RECORD_HEAD.size <= end:
        op, length = RECORD_HEAD.unpack_from(data, at)
        following = at + RECORD_HEAD.size + length
        if following > end:
            return
        if op == Op.MESSAGE:
            _, _, channel, _, log_ns, publish_ns = MESSAGE_HEAD.unpack_from(data, at)
            if channel in channels:
                yield RawMessage(channel, log_ns, publish_ns, bytes(data[at + head : following]))
        at = following
