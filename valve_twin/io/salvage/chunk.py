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
from dataclasses import dataclass
from typing import TYPE_CHECKING

import zstandard

from valve_twin.io.limits import too_large, unpack_limit
from valve_twin.io.mcap.format import RECORD_HEAD, ChunkIndex, Op
from valve_twin.io.salvage.walk import walk

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from valve_twin.io.salvage.records import Bytes

_MARKS = {b"\x28\xb5\x2f\xfd": "zstd", b"\x04\x22\x4d\x18": "lz4"}
_NAMES = {0: "", 3: "lz4", 4: "zstd"}
_FIXED = struct.Struct("<QQQII")
_PACKED = struct.Struct("<Q")
_USUAL = 1 << 26
_LONG_STEP, _STEP = 1 << 12, 1 << 10
"""Packed bytes that are unpacked at a time: a bomb of zstd makes 32 768 of each."""

_OUTSIDE = "it is damaged outside its messages, which its check sum proves"
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

    def is_sound(self, data: Bytes) -> bool:
        """Return whether nothing in it contradicts another thing."""
        return data[self.offset] == Op.CHUNK and self.agrees and self.literal

    def lengths(self, end: int, hint: ChunkIndex | None) -> list[int]:
        """Return how many compressed bytes there may be before the end of the file [B]."""
        given = [self.packed, self.end - self.packed_at]
        if hint is not None:
            given += [hint.compressed_size, hint.length - (self.packed_at - self.offset)]
        return [n for n in dict.fromkeys(given) if 0 <= n <= end - self.packed_at]


@dataclass(frozen=True, slots=True)
class Unpacked:
    """Records of a chunk and how far they can be believed.

    Attributes
    ----------
    records : bytes
        The records; a part of them where the chunk is cut or torn.
    end : int or None
        Where the chunk ends in the file [B], None = not known.
    reason : str
        What is wrong, empty = nothing.
    verified : bool
        Whether the check sum stands for them.
    plain : bool
        Whether a reader that believes the head reads the same.
    """

    records: bytes = b""
    end: int | None = None
    reason: str = ""
    verified: bool = False
    plain: bool = False


def read_heads(data: Bytes, at: int, end: int) -> list[ChunkHead]:
    """Return every reading of the head of a chunk, the likeliest first.

    Parameters
    ----------
    data : bytes
        The file.
    at, end : int
        Where the chunk begins and where the bytes of the file end.
    """
    fixed_at = at + RECORD_HEAD.size
    if fixed_at + _FIXED.size > end:
        return []
    _, length = RECORD_HEAD.unpack_from(data, at)
    start_ns, end_ns, size, crc, given = _FIXED.unpack_from(data, fixed_at)
    heads = []
    for named in dict.fromkeys((given, 4, 3, 0)):
        name_at = fixed_at + _FIXED.size
        packed_at = name_at + named + _PACKED.size
        if named not in _NAMES or packed_at > end:
            continue
        name = bytes(data[name_at : name_at + named]).decode(errors="replace")
        (packed,) = _PACKED.unpack_from(data, name_at + named)
        stop = fixed_at + length
        heads.append(
            ChunkHead(
                at, stop, start_ns, end_ns, size, crc, name, packed_at, int(packed), named == given
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
        return Unpacked(reason="its head is cut")
    problem = too_large(heads[0].size, min(heads[0].packed, end - at))
    if problem and heads[0].is_sound(data) and heads[0].compression:
        return Unpacked(end=heads[0].end, reason=f"it {problem}")
    for head in heads:
        found = _verified(data, head, end, hint) if head.crc else None
        if found is not None:
            return found
    head = heads[0]
    cut = head.agrees and head.end > end
    if head.crc and not cut:
        return _nearly(data, head, end) or Unpacked(reason="its check sum is wrong")
    return _unverified(data, head, end, hint, cut=cut)


@dataclass(frozen=True, slots=True)
class _Attempt:
    """One way to unpack; `used` is None where the end of the compressed bytes was not reached."""

    length: int
    compression: str
    records: bytes
    used: int | None


def _attempts(
    data: Bytes, head: ChunkHead, lengths: Iterable[int], hint: ChunkIndex | None
) -> Iterator[_Attempt]:
    most = unpack_limit()
    sizes = [n for n in (head.size, hint.size if hint else 0) if n <= most]
    for length in lengths:
        packed = bytes(data[head.packed_at : head.packed_at + length])
        marked = [name for mark, name in _MARKS.items() if packed.startswith(mark)]
        known = head.compression in _NAMES.values()
        named = [head.compression] if known else list(_NAMES.values())
        for name in dict.fromkeys((*named, *marked)):
            limit = min(most, max((_USUAL, *sizes)))
            yield _Attempt(length, name, *inflate(packed, name, limit))


def _verified(data: Bytes, head: ChunkHead, end: int, hint: ChunkIndex | None) -> Unpacked | None:
    for one in _attempts(data, head, head.lengths(end, hint), hint):
        records = one.records
        if zlib.crc32(records) != head.crc or (not records and head.size):
            continue
        stop = head.packed_at + (one.length if one.used is None else one.used)
        sound = head.is_sound(data) and one.used == head.packed
        plain = sound and one.compression == head.compression and len(records) == head.size
        return Unpacked(records, stop, "" if plain else _OUTSIDE, verified=True, plain=plain)
    return None


def _nearly(data: Bytes, head: ChunkHead, end: int) -> Unpacked | None:
    """Believe, unverified, a chunk that is whole where one byte of its check sum differs."""
    lengths = [head.packed] if head.agrees and head.end <= end else []
    for one in _attempts(data, head, lengths, None):
        other = zlib.crc32(one.records) ^ head.crc
        one_byte = sum(bool(other >> shift & 0xFF) for shift in (0, 8, 16, 24)) == 1
        whole = one.used is not None and len(one.records) == head.size
        if whole and one_byte and walk(one.records).whole:
            reason = "one byte of its check sum is damaged, its messages are not verified"
            return Unpacked(one.records, head.end, reason)
    return None


def _unverified(
    data: Bytes, head: ChunkHead, end: int, hint: ChunkIndex | None, *, cut: bool
) -> Unpacked:
    """Take what unpacks of a chunk without check sum, or of one that the end of the file cuts."""
    reason = _CUT if cut else _TORN
    best = Unpacked(reason=reason)
    lengths = [end - head.packed_at] if cut else head.lengths(end, hint)
    for one in _attempts(data, head, lengths, hint):
        if not cut and one.used is not None and len(one.records) == head.size:
            plain = head.is_sound(data) and one.compression == head.compression
            problem = "" if plain else "its head is damaged and it has no check sum"
            return Unpacked(one.records, head.packed_at + one.used, problem, plain=plain)
        if len(one.records) > len(best.records):
            stop = None if cut else head.packed_at + one.length
            best = Unpacked(one.records, stop, reason)
    return best


def inflate(packed: bytes, compression: str, limit: int) -> tuple[bytes, int | None]:
    """Return what unpacks of compressed bytes, and how many of them that took.

    Parameters
    ----------
    packed : bytes
        The compressed bytes, perhaps cut or damaged.
    compression : str
        "zstd", "lz4" or "".
    limit : int
        Give up beyond this many bytes.

    Returns
    -------
    bytes, int or None
        The bytes; None where their end was not reached.
    """
    if not compression:
        return packed, len(packed)
    for step in (_LONG_STEP, _STEP):
        stream = _stream(compression)
        parts: list[bytes] = []
        size, at = 0, 0
        try:
            for at in range(0, len(packed), step):
                parts.append(stream.decompress(packed[at : at + step]))
                size += len(parts[-1])
                if stream.eof:
                    break
                if size > limit:
                    return b"", None
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
