# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read one MCAP file: its summary, and its chunks decompressed and checked."""

from __future__ import annotations

import struct
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import zstandard
from mcap.records import Metadata

from valve_twin.io.errors import BagError, IndexLiesError
from valve_twin.io.limits import too_large
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
from valve_twin.io.mcap.index_check import Flaw, find_flaw
from valve_twin.io.mcap.mapped import STRIDE, MappedFile
from valve_twin.io.mcap.summary import (
    OF_DATA,
    Defined,
    Loose,
    Summary,
    contradiction,
    metadata_places,
    records_of,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from valve_twin.core.types import ByteArray
    from valve_twin.io.mcap.damage import Salvage


_MODEST = _PIECE = 1 << 24
_CHUNK_HEAD = struct.Struct("<QQQII")
"""First and last log time, decompressed size, check sum, length of the compression's name."""

_WHOLE_HEAD = struct.Struct("<BQQQQII")
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


class _DefinedOtherwiseError(DamagedError):
    """A chunk defines topics or types otherwise than the summary: who chose by it is misled."""


class McapFile:
    """One open file.

    `content` is all of it, (N,) uint8, without a copy; `sum_stands` says whether the chunk that
    was read last has a check sum.

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
        self._kept = set() if salvaged is None else {c.offset for c in salvaged.summary.chunks}
        self._salvage = salvage
        self._file = MappedFile(path)
        self._map = self._file.data
        self._view = memoryview(self._map)
        self.content: ByteArray = np.frombuffer(self._view, dtype=np.uint8)
        self._compared: set[int] = set()
        self._sums: dict[int, int] = {}
        self.defined = Defined()
        self.sum_stands = False
        self._unpacker = zstandard.ZstdDecompressor()
        self.summary = Summary()
        try:
            if salvaged is None:
                self.summary = self._read_summary()
        except (*_BROKEN, DamagedError) as err:
            self._salvaged(self._refusal(err))
        if self.damage is not None:
            self.summary = self.damage.summary
        self.defined = Defined(self.summary)
        self._is_salvaged = self.damage is not None

    def _refusal(self, err: Exception) -> BagError:
        if isinstance(err, BagError):
            return err
        return DamagedError(f"{self.path}: the summary is damaged ({err}); {_RECOVER}")

    def _salvaged(self, err: BagError) -> Salvage:
        """Return what is intact of the file; raise the error where nothing is.

        What is intact is read by the name: it has to lead to the same file still.
        """
        self._file.check_same()
        found = None if self._salvage is None else self._salvage(self.path)
        if found is None or (not found.rescued and not found.summary.chunks):
            self.close()
            raise err
        self.damage = found
        self._kept = {c.offset for c in found.summary.chunks}
        return found

    def close(self) -> None:
        """Close the file; what still looks into it keeps it mapped."""
        self.content = np.empty(0, dtype=np.uint8)
        with suppress(BufferError):
            self._view.release()
            self._map.close()

    def chunk(self, index: ChunkIndex) -> bytes:
        """Return the decompressed records of a chunk, compared with what is stated about them.

        Raises
        ------
        BagError
            If it is damaged or compressed in an unknown way.
        IndexLiesError
            If chunks stand at other places or times than stated.
        """
        records = bytes(self.chunk_view(index))
        if self.damage is not None or index.offset in self._compared:
            return records
        if self.doubt(index, self.flaw_of(index, records)):
            return bytes(self.chunk_view(index))  # without a check sum a part may be left out
        return records

    @property
    def is_sound(self) -> bool:
        """Whether no damage and no false statement was met so far."""
        return self.damage is None

    def flaw_of(self, index: ChunkIndex, records: bytes | memoryview) -> Flaw:
        """Return how the records of a chunk compare with what is stated about them."""
        stated = self._view[index.index_at : index.index_at + index.index_length]
        span, defined = (index.start_ns, index.end_ns), self.defined
        return find_flaw(records, stated, *span, defined.holds, defined.channels)

    def doubt(self, index: ChunkIndex, flaw: Flaw) -> bool:
        """Take note of how a chunk compares with what is stated about it.

        At the first flaw the whole file is read by its data section, which says on the log what
        else is wrong with it; the records that were read stand.

        Parameters
        ----------
        index : ChunkIndex
            The chunk.
        flaw : Flaw
            What was found; `Flaw.NONE` = nothing.

        Returns
        -------
        bool
            Whether the file is read by its data section from here on.

        Raises
        ------
        IndexLiesError
            If chunks stand elsewhere or at other times than stated, or define topics otherwise.
        BagError
            If damaged files are refused.
        """
        self._compared.add(index.offset)
        if flaw is Flaw.NONE or self.damage is not None:
            return False
        damaged = self._damaged(index, flaw.text)
        self._salvaged(damaged)
        if flaw is Flaw.DEFINITIONS:
            raise IndexLiesError(str(damaged))
        self._check_order(index, flaw.text)
        return True

    def _check_order(self, index: ChunkIndex, what: str) -> None:
        """Begin anew where chunks stand or lie in time otherwise than the summary states."""
        assert self.damage is not None
        stated = {c.offset: c for c in self.summary.chunks}
        for chunk in self.damage.summary.chunks if stated else ():
            known = stated.get(chunk.offset)
            if known is None or chunk.start_ns < known.start_ns or chunk.end_ns > known.end_ns:
                msg = f"{self.path}: chunk at byte {index.offset}: {what}; {_RECOVER}"
                raise IndexLiesError(msg)

    def chunk_view(self, index: ChunkIndex) -> bytes | memoryview:
        """Return the decompressed records of a chunk without a copy; valid while it is open.

        Raises
        ------
        BagError
            If it is damaged and nothing in the file is intact.
        IndexLiesError
            If it is damaged, and others stand elsewhere than stated, or defines topics otherwise.
        """
        try:
            return self._unpacked(index) if self.damage is None else self._rescued(index)
        except DamagedError as err:
            self._salvaged(err)
            if isinstance(err, _DefinedOtherwiseError):
                raise IndexLiesError(str(err)) from err
            self._check_order(index, "it is damaged, and the summary lies about others")
            return self._rescued(index)

    def _rescued(self, index: ChunkIndex) -> bytes | memoryview:
        """Return what is intact of a chunk of a damaged file."""
        assert self.damage is not None
        if index.offset in self.damage.rescued:
            return self.damage.rescued[index.offset]
        if index.offset not in self._kept:
            return b""
        try:
            return self._unpacked(index)
        except DamagedError:
            return b""

    def _unpacked(self, index: ChunkIndex) -> bytes | memoryview:
        """Return the records of a chunk as it stands in the file."""
        self._file.check_whole()
        try:
            op, length, start_ns, end_ns, size, crc, named = _WHOLE_HEAD.unpack_from(
                self._view, index.offset
            )
            begin = index.offset + RECORD_HEAD.size
            at = begin + _CHUNK_HEAD.size + named
            (packed,) = _LENGTH.unpack_from(self._view, at)
        except _BROKEN as err:
            raise self._damaged(index, f"cannot be read ({err})") from err
        at += _LENGTH.size
        if op != Op.CHUNK or at + packed > begin + length:
            raise self._damaged(index, "there is no chunk")
        if size > _MODEST and named and (problem := too_large(size, packed)):
            raise self._damaged(index, f"it {problem}")
        if self.damage is None and (
            self._sums.setdefault(crc or start_ns, index.offset) != index.offset
            or start_ns != index.start_ns
            or end_ns != index.end_ns
            or length + RECORD_HEAD.size != index.length
        ):
            self._compare_heads(index, crc or start_ns, (start_ns, end_ns, size))
        name = self._view[at - _LENGTH.size - named : at - _LENGTH.size]
        data = self._decompress(bytes(name), self._view[at : at + packed], size, index)
        self.sum_stands = crc != 0
        if len(data) != size or (crc and crc32(data) != crc):
            raise self._damaged(index, "its check sum is wrong")
        if self.damage is None and not self.defined.begins(data):
            raise _DefinedOtherwiseError(str(self._damaged(index, Flaw.DEFINITIONS.text)))
        return data

    def _compare_heads(self, index: ChunkIndex, key: int, stated: tuple[int, int, int]) -> None:
        """Refuse a chunk that the summary knows otherwise, or that repeats another."""
        if stated != (index.start_ns, index.end_ns, index.size):
            raise self._damaged(index, "the summary knows it otherwise")
        before = self._sums[key]
        if before == index.offset or stated[0] == stated[1]:
            return
        if self._view[before : before + index.length] == self._view[index.offset : index.index_at]:
            raise self._damaged(index, f"it repeats the one at byte {before}")

    def _decompress(
        self, compression: bytes, packed: memoryview, size: int, index: ChunkIndex
    ) -> bytes | memoryview:
        try:
            if compression == b"zstd":
                claimed = zstandard.frame_content_size(packed)
                if claimed > size:
                    raise self._damaged(index, f"it claims {size} bytes and unpacks to {claimed}")
                return self._unpacker.decompress(packed, max_output_size=size)
            if compression == b"lz4":
                import lz4.frame

                return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, size + 1))
        except (zstandard.ZstdError, RuntimeError, MemoryError, EOFError) as err:
            raise self._damaged(index, f"cannot be unpacked ({err})") from err
        if compression:
            what = f"compression '{compression.decode(errors='replace')}' is unknown"
            raise self._damaged(index, what, "record with zstd, lz4 or none")
        return packed

    def _damaged(self, index: ChunkIndex, what: str, remedy: str = _RECOVER) -> DamagedError:
        return DamagedError(f"{self.path}: chunk at byte {index.offset}: {what}; {remedy}")

    def loose_messages(self) -> Iterator[memoryview]:
        """Yield the data section of a file that has messages outside chunks, piece by piece.

        Raises
        ------
        BagError
            If it was cut since it was opened.
        """
        if not self._is_salvaged:
            yield from record_pieces(self._view[len(MAGIC) :], _PIECE, self._file.check_whole)

    def _read_summary(self) -> Summary:
        if len(self._map) < 2 * len(MAGIC) + FOOTER_SIZE or self._map[-len(MAGIC) :] != MAGIC:
            msg = f"{self.path}: was cut after {len(self._map)} bytes, its recorder did not finish"
            raise DamagedError(msg + " it; rewrite it with 'valve-twin recover'")
        if self._map[: len(MAGIC)] != MAGIC:
            msg = "the mark at its begin is wrong"
            raise ValueError(msg)
        footer = self._map[-FOOTER_SIZE : -len(MAGIC)]
        op, _, start, _, crc = struct.unpack_from("<BQQQI", footer)
        if op != Op.FOOTER:
            msg = "no footer"
            raise ValueError(msg)
        if start == 0:
            end = len(self._map) - FOOTER_SIZE
            summary = self._scan(end)
            problem = contradiction(self._map, summary, end)
            if problem:
                raise ValueError(problem)
            return summary
        tail = self._map[start : len(self._map) - len(MAGIC)]
        if crc and crc32(tail[:-4]) != crc:
            msg = "check sum of the summary is wrong"
            raise ValueError(msg)
        summary = Summary()
        for op, begin, end in records_of(tail):
            summary.add(op, tail[begin:end])
        counted = summary.statistics
        known, chunked = summary.chunks, counted is None or counted.chunk_count
        if (not known and chunked) or summary.lacks_definitions:
            summary = self._scan(start)
            summary.statistics = counted or summary.statistics
        problem = contradiction(self._map, summary, start)
        if problem:
            raise ValueError(problem)
        for name, (offset, length) in metadata_places(tail).items():
            body = self._map[offset + RECORD_HEAD.size : offset + length]
            found = Metadata.read(Body(body))
            summary.metadata[name] = found.metadata if found.name == name else {}
        return summary

    def _scan(self, end: int) -> Summary:
        """Read the records of the data section one by one: the summary names no chunks."""
        summary, loose = Summary(), Loose()
        data, checked = self._view[len(MAGIC) : end], 0
        for op, begin, stop in records_of(data):
            if stop > checked:
                self._file.check_whole()
                checked = stop + STRIDE
            at = len(MAGIC) + begin - RECORD_HEAD.size
            if op == Op.CHUNK:
                start, last, size, *_ = _CHUNK_HEAD.unpack_from(data, begin)
                length = stop - begin + RECORD_HEAD.size
                summary.chunks.append(ChunkIndex(start, last, at, length, {}, 0, "", 0, size))
            elif op == Op.MESSAGE_INDEX and summary.chunks:
                chunk = summary.chunks[-1]
                channel = int.from_bytes(data[begin : begin + 2], "little")
                summary.chunks[-1] = chunk._replace(
                    message_indexes={**chunk.message_indexes, channel: at},
                    index_length=chunk.index_length + stop - begin + RECORD_HEAD.size,
                )
            elif op == Op.MESSAGE:
                loose.add(data, begin - RECORD_HEAD.size)
            elif op in OF_DATA:  # what a summary would say is no truth here
                summary.add(op, bytes(data[begin:stop]))
        for chunk in summary.chunks:
            summary.take(self.chunk(chunk))
        if not summary.chunks:
            summary.statistics = loose.statistics()
        return summary


def record_pieces(
    data: memoryview, size: int, check: Callable[[], object] = lambda: None
) -> Iterator[memoryview]:
    """Cut a long section between two records into pieces of about a size [B].

    Parameters
    ----------
    data : memoryview
        The section.
    size : int
        Of a piece [B].
    check : callable
        Called before each stride and each piece is looked into.
    """
    at = begin = checked = 0
    while len(data) - begin > size and at + RECORD_HEAD.size <= len(data):
        if at - begin >= size:
            check()
            yield data[begin:at]
            begin = checked = at
        if at >= checked:
            check()
            checked = at + STRIDE
        at += RECORD_HEAD.size + RECORD_HEAD.unpack_from(data, at)[1]
    check()
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
