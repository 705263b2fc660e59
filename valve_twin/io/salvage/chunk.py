# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Unpack a chunk of which any byte may be wrong or the end may be missing.

The head of a chunk holds most of what it says twice: two lengths, the name of the compression and
the mark that the compressed bytes begin with. Every reading of it is tried; the check sum of the
unpacked records decides.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import zstandard

from valve_twin.io.mcap.format import (
    MESSAGE_HEAD,
    RECORD_HEAD,
    Channel,
    ChunkIndex,
    Op,
    Schema,
    read_channel,
    read_schema,
)
from valve_twin.io.mcap.summary import records_of

if TYPE_CHECKING:
    from valve_twin.io.salvage.records import Bytes

_MARKS = {b"\x28\xb5\x2f\xfd": "zstd", b"\x04\x22\x4d\x18": "lz4"}
_NAMES = {0: "", 3: "lz4", 4: "zstd"}
_FIXED = struct.Struct("<QQQII")
_PACKED = struct.Struct("<Q")
_MOST = 1 << 30
_USUAL = 1 << 26
_STEP = 1 << 10
_NEVER = 2**64
_CUT = "the file ends in it; what unpacks is not verified"
_TORN = "it is damaged and has no check sum; what unpacks is not verified"


@dataclass(frozen=True, slots=True)
class ChunkHead:
    """What the head of a chunk says; offsets and sizes in bytes, times in ns.

    Attributes
    ----------
    offset, end : int
        Where the record begins and where it ends by its first length.
    start_ns, end_ns, size, crc : int
        First and last log time, bytes and check sum of the records (0 = none).
    compression : str
        Its name, or what stands there instead.
    packed_at, packed : int
        Where the compressed bytes begin and how many there are by the second length.
    literal : bool
        Whether the length of the name is the one that stands there.
    """

    offset: int
    end: int
    start_ns: int
    end_ns: int
    size: int
    crc: int
    compression: str
    packed_at: int
    packed: int
    literal: bool

    @property
    def agrees(self) -> bool:
        """Whether both lengths say the same."""
        return self.packed_at + self.packed == self.end


@dataclass(frozen=True, slots=True)
class Unpacked:
    """Records of a chunk and how far they can be believed.

    Attributes
    ----------
    records : bytes
        The records; a part of them where the chunk is cut or torn.
    verified : bool
        Whether the check sum stands for them.
    plain : bool
        Whether a reader that believes the head reads the same.
    end : int or None
        Where the chunk ends in the file [B], None = not known.
    reason : str
        What is wrong, empty = nothing.
    """

    records: bytes
    verified: bool
    plain: bool
    end: int | None
    reason: str = ""


def read_heads(data: Bytes, at: int, end: int) -> list[ChunkHead]:
    """Return every reading of the head of a chunk, the likeliest first."""
    fixed_at = at + RECORD_HEAD.size
    if fixed_at + _FIXED.size > end:
        return []
    _, length = RECORD_HEAD.unpack_from(data, at)
    start_ns, end_ns, size, crc, told = _FIXED.unpack_from(data, fixed_at)
    heads = []
    for named in dict.fromkeys((told, 4, 3, 0)):
        if named not in _NAMES:
            continue
        name_at = fixed_at + _FIXED.size
        packed_at = name_at + named + _PACKED.size
        if packed_at > end:
            continue
        name = bytes(data[name_at : name_at + named]).decode(errors="replace")
        (packed,) = _PACKED.unpack_from(data, name_at + named)
        stop = fixed_at + length
        heads.append(
            ChunkHead(
                at, stop, start_ns, end_ns, size, crc, name, packed_at, int(packed), named == told
            )
        )
    heads.sort(key=lambda head: not head.agrees)
    return heads


def unpack(data: Bytes, at: int, end: int, hint: ChunkIndex | None = None) -> Unpacked:
    """Unpack the chunk at a place as far as it goes.

    Parameters
    ----------
    data : bytes
        The file.
    at, end : int
        Where the chunk begins and where the bytes of the file end.
    hint : ChunkIndex, optional
        What the summary says about it.

    Returns
    -------
    Unpacked
        Verified where a check sum stands and is right; empty where nothing may be believed.
    """
    heads = read_heads(data, at, end)
    if not heads:
        return Unpacked(b"", verified=False, plain=False, end=None, reason="its head is cut")
    for head in heads:
        found = _verified(data, head, end, hint)
        if found is not None:
            return found
    head = heads[0]
    if head.crc and not _runs_over(head, end):
        return _nearly(data, head, end) or Unpacked(
            b"", verified=False, plain=False, end=None, reason="its check sum is wrong"
        )
    return _unverified(data, head, end, hint)


def _lengths(head: ChunkHead, end: int, hint: ChunkIndex | None) -> list[int]:
    told = [head.packed, head.end - head.packed_at]
    if hint is not None:
        told += [hint.compressed_size, hint.length - (head.packed_at - head.offset)]
    return [n for n in dict.fromkeys(told) if 0 <= n <= end - head.packed_at]


def _verified(data: Bytes, head: ChunkHead, end: int, hint: ChunkIndex | None) -> Unpacked | None:
    if not head.crc:
        return None
    for length in _lengths(head, end, hint):
        packed = bytes(data[head.packed_at : head.packed_at + length])
        for name in _compressions(head, packed):
            records, used = inflate(packed, name, _limit(head, hint))
            if zlib.crc32(records) != head.crc or (not records and head.size):
                continue
            stop = head.packed_at + (length if used is None else used)
            sound = _is_marked(data, head) and used == head.packed
            plain = sound and name == head.compression and len(records) == head.size
            reason = (
                "" if plain else "it is damaged outside its messages, which its check sum proves"
            )
            return Unpacked(records, verified=True, plain=plain, end=stop, reason=reason)
    return None


def _nearly(data: Bytes, head: ChunkHead, end: int) -> Unpacked | None:
    """Believe, unverified, a chunk that is whole where one byte of its check sum differs."""
    if not head.agrees or head.end > end:
        return None
    packed = bytes(data[head.packed_at : head.end])
    for name in _compressions(head, packed):
        records, used = inflate(packed, name, _limit(head, None))
        other = zlib.crc32(records) ^ head.crc
        one_byte = sum(bool(other >> shift & 0xFF) for shift in (0, 8, 16, 24)) == 1
        if used is not None and len(records) == head.size and one_byte and walk(records).whole:
            return Unpacked(
                records,
                verified=False,
                plain=False,
                end=head.end,
                reason="one byte of its check sum is damaged, its messages are not verified",
            )
    return None


def _unverified(
    data: Bytes, head: ChunkHead, end: int, hint: ChunkIndex | None = None
) -> Unpacked:
    """Take what unpacks of a chunk without check sum, or of one that the end of the file cuts."""
    cut = _runs_over(head, end)
    lengths = [end - head.packed_at] if cut else _lengths(head, end, hint)
    best = Unpacked(b"", verified=False, plain=False, end=None, reason=_CUT if cut else _TORN)
    for length in lengths:
        packed = bytes(data[head.packed_at : head.packed_at + length])
        stop = None if cut else head.packed_at + length
        for name in _compressions(head, packed):
            records, used = inflate(packed, name, _limit(head, hint))
            if not cut and used is not None and len(records) == head.size:
                stop = head.packed_at + used
                plain = _is_marked(data, head) and name == head.compression
                reason = "" if plain else "its head is damaged and it has no check sum"
                return Unpacked(records, verified=False, plain=plain, end=stop, reason=reason)
            if len(records) > len(best.records):
                best = Unpacked(
                    records, verified=False, plain=False, end=stop, reason=_CUT if cut else _TORN
                )
    return best


def _is_marked(data: Bytes, head: ChunkHead) -> bool:
    """Return whether the head itself is sound."""
    return data[head.offset] == Op.CHUNK and head.agrees and head.literal


def _runs_over(head: ChunkHead, end: int) -> bool:
    """Return whether the file ends before the chunk does."""
    return head.agrees and head.end > end


def _limit(head: ChunkHead, hint: ChunkIndex | None) -> int:
    told = [n for n in (head.size, hint.size if hint else 0) if n <= _MOST]
    return max((_USUAL, *told))


def _compressions(head: ChunkHead, packed: bytes) -> list[str]:
    marked = [name for mark, name in _MARKS.items() if packed.startswith(mark)]
    named = [head.compression] if head.compression in _NAMES.values() else list(_NAMES.values())
    return list(dict.fromkeys((*named, *marked)))


def inflate(packed: bytes, compression: str, limit: int) -> tuple[bytes, int | None]:
    """Return what unpacks of compressed bytes, and how many of them that took.

    Parameters
    ----------
    packed : bytes
        The compressed bytes, perhaps cut or damaged.
    compression : str
        "zstd", "lz4" or "".
    limit : int
        Stop beyond this many bytes.

    Returns
    -------
    bytes, int or None
        The bytes; None where their end was not reached.
    """
    if not compression:
        return packed, len(packed)
    for step in (max(1, len(packed)), _STEP):
        stream = _stream(compression)
        parts: list[bytes] = []
        size, at = 0, 0
        try:
            for at in range(0, len(packed), step):
                parts.append(stream.decompress(packed[at : at + step]))
                size += len(parts[-1])
                if stream.eof or size > limit:
                    break
        except (zstandard.ZstdError, RuntimeError, MemoryError, EOFError):
            if step == _STEP:
                return b"".join(parts), None
            continue
        used = min(at + step, len(packed)) - len(stream.unused_data or b"")
        return b"".join(parts), used if stream.eof else None
    return b"", None


def _stream(compression: str):  # type: ignore[no-untyped-def]  # noqa: ANN202
    if compression == "zstd":
        return zstandard.ZstdDecompressor().decompressobj()
    import lz4.frame

    return lz4.frame.LZ4FrameDecompressor()


@dataclass(slots=True)
class Walk:
    """What the records of a chunk hold.

    Attributes
    ----------
    schemas, channels : dict
        Definitions in it by number.
    counts : dict
        Messages by channel.
    start_ns, end_ns : int
        First and last log time [ns]; start_ns > end_ns where there is no message.
    end : int
        Where the last whole record ends [B].
    whole : bool
        Whether that is the end of the records.
    """

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)
    start_ns: int = _NEVER
    end_ns: int = -1
    end: int = 0
    whole: bool = False

    @property
    def messages(self) -> int:
        """How many messages there are."""
        return sum(self.counts.values())


@dataclass(slots=True)
class Piece:
    """A chunk that was found, or messages outside chunks.

    Attributes
    ----------
    offset, length : int
        Where it lies in the file [B].
    verified : bool
        Whether a check sum stands for it.
    records : bytes or None
        Its records; None where any reader reads them out of the file.
    found : Walk
        What is in it.
    size : int
        Bytes of its records [B].
    index : dict
        Where its message indexes lie, by channel.
    """

    offset: int
    length: int
    verified: bool
    records: bytes | None
    found: Walk
    size: int
    index: dict[int, int] = field(default_factory=dict)


def walk(records: bytes) -> Walk:
    """Count what the records of a chunk hold, up to the first that runs over their end."""
    found = Walk()
    at, end = 0, len(records)
    for op, begin, stop in records_of(records):
        if op == Op.MESSAGE:
            if stop - at < MESSAGE_HEAD.size:
                break
            _, _, channel, _, log_ns, _ = MESSAGE_HEAD.unpack_from(records, at)
            found.counts[channel] = found.counts.get(channel, 0) + 1
            found.start_ns = min(found.start_ns, log_ns)
            found.end_ns = max(found.end_ns, log_ns)
        else:
            _define(found, op, records[begin:stop])
        at = stop
    found.end, found.whole = at, at == end
    return found


def _define(found: Walk, op: int, body: bytes) -> None:
    try:
        if op == Op.SCHEMA:
            schema = read_schema(body)
            found.schemas[schema.id] = schema
        elif op == Op.CHANNEL:
            channel = read_channel(body)
            found.channels[channel.id] = channel
    except (struct.error, ValueError):
        return
