# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What indexes and summary say otherwise than the data section, which is the truth."""

from __future__ import annotations

import struct
from collections import Counter
from itertools import groupby
from typing import TYPE_CHECKING, NamedTuple

from valve_twin.io.mcap.checksum import crc32
from valve_twin.io.mcap.format import FOOTER_SIZE, RECORD_HEAD, Op
from valve_twin.io.mcap.index_check import Flaw, find_flaw
from valve_twin.io.salvage.records import record_end
from valve_twin.io.salvage.tail import Trust

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from valve_twin.io.mcap.format import ChunkIndex, Statistics
    from valve_twin.io.salvage.piece import Piece
    from valve_twin.io.salvage.records import Bytes
    from valve_twin.io.salvage.tail import Tail

_PIECE = 1 << 24
_OFFSET = struct.Struct("<BQQ")


class Remark(NamedTuple):
    """One disagreement that loses nothing: where [B], what, and how it differs."""

    at: int
    stop: int
    what: str
    why: str


def indexes_end(data: Bytes, at: int, end: int) -> int:
    """Return where the message indexes that begin at a place end [B].

    Parameters
    ----------
    data : bytes
        The file.
    at, end : int
        Where the first may begin and where the data section ends [B].
    """
    while at + RECORD_HEAD.size <= end and data[at] == Op.MESSAGE_INDEX:
        stop = record_end(data, at, end)
        if stop is None:
            return at
        at = stop
    return at


def of_chunk(data: Bytes, piece: Piece, records: bytes, end: int) -> Iterator[Remark]:
    """Yield where head and indexes of a sound chunk disagree with its messages.

    Parameters
    ----------
    data : bytes
        The file.
    piece : Piece
        The chunk.
    records : bytes
        What it holds.
    end : int
        Where the data section ends [B].
    """
    found, begin = piece.found, piece.offset + piece.length
    stop = indexes_end(data, begin, end)
    flaw = find_flaw(records, bytes(data[begin:stop]), 0, 2**64) if found.whole else Flaw.NONE
    if flaw is not Flaw.NONE:
        yield Remark(
            begin, stop, "message index", f"of the chunk at byte {piece.offset}: {flaw.text}"
        )
    for stated, what in ((piece.head, "chunk"), (piece.hint, "chunk index")):
        if stated is None or not found.counts:
            continue
        if (stated.start_ns, stated.end_ns) != (found.start_ns, found.end_ns):
            why = f"of the chunk at byte {piece.offset}: {Flaw.TIMES.text}"
            if stated.start_ns <= found.start_ns and found.end_ns <= stated.end_ns:
                continue
            yield Remark(piece.offset, begin, what, why)


def of_summary(
    tail: Tail, pieces: Sequence[Piece], found: Statistics, losses: int
) -> Iterator[Remark]:
    """Yield where a summary disagrees with what was found.

    Parameters
    ----------
    tail : Tail
        The end of the file.
    pieces : sequence of Piece
        What was found.
    found : Statistics
        Counts of what is readable.
    losses : int
        Damaged places that were told already [1].
    """
    if tail.trust not in {Trust.VERIFIED, Trust.UNCHECKED} or losses:
        return
    summary = tail.summary
    known: dict[int, ChunkIndex] = {c.offset: c for c in summary.chunks}
    chunks = [p for p in pieces if p.head is not None]
    if summary.chunks:
        twice = len(summary.chunks) - len(known)
        strange = known.keys() - {p.offset for p in chunks}
        missing = [p for p in chunks if p.offset not in known]
        if twice or strange or missing:
            why = (
                f"it names {twice} chunks twice, {len(strange)} that are not there and leaves out "
                f"{len(missing)}"
            )
            yield Remark(tail.begin, tail.begin, "summary", why)
        for piece in chunks:
            stated = known.get(piece.offset)
            if stated is not None and not _knows(stated, piece):
                why = (
                    f"it states other places, sizes or topics of the chunk at byte {piece.offset}"
                )
                yield Remark(tail.begin, tail.begin, "chunk index", why)
    unknown = [i for i, n in found.counts.items() if n and i not in summary.channels]
    if summary.channels and unknown:
        why = f"it leaves out the topics of channels {', '.join(map(str, sorted(unknown)))}"
        yield Remark(tail.begin, tail.begin, "summary", why)
    yield from _of_statistics(tail, chunks, found)


def _knows(stated: ChunkIndex, piece: Piece) -> bool:
    """Return whether the summary describes a chunk as it is."""
    if stated.length != piece.length or stated.size != piece.size:
        return False
    return not stated.message_indexes or dict(stated.message_indexes) == piece.index


def _of_statistics(tail: Tail, chunks: Sequence[Piece], found: Statistics) -> Iterator[Remark]:
    stated = tail.summary.statistics
    if stated is None:
        return
    problems = []
    if stated.counts and sum(stated.counts.values()) != stated.message_count:
        problems.append("its counts do not add up")
    if stated.message_count < found.message_count:
        problems.append(
            f"it counts {stated.message_count} messages, the file holds {found.message_count}"
        )
    elif stated.counts and not Counter(found.counts) <= Counter(stated.counts):
        problems.append("it counts other messages of its topics than the file holds")
    if stated.chunk_count != len(chunks):
        problems.append(f"it counts {stated.chunk_count} chunks, the file holds {len(chunks)}")
    if found.message_count and (stated.start_ns, stated.end_ns) != (found.start_ns, found.end_ns):
        problems.append("it states other times than the messages have")
    if problems:
        yield Remark(tail.begin, tail.begin, "statistics", "; ".join(problems))


def of_attachment(data: Bytes, at: int, stop: int) -> Remark | None:
    """Return what is wrong with an attachment, of which nothing is read; None = nothing.

    Parameters
    ----------
    data : bytes
        The file.
    at, stop : int
        Where its record begins and ends [B].
    """
    crc = int.from_bytes(data[stop - 4 : stop], "little")
    if crc in {0, _sum(data, at + RECORD_HEAD.size, stop - 4)}:
        return None
    return Remark(at, stop, "attachment", "its check sum is wrong")


def _sum(data: Bytes, at: int, stop: int, check: Callable[[], object] = lambda: None) -> int:
    """Return the check sum of a part, piece by piece: it may be larger than memory."""
    found = 0
    for begin in range(at, stop, _PIECE):
        check()
        found = crc32(data[begin : min(begin + _PIECE, stop)], found)
    return found


def of_sums(data: Bytes, tail: Tail, check: Callable[[], object]) -> Iterator[Remark]:
    """Yield what is stated falsely of whole sections of a file in which nothing else is wrong.

    Parameters
    ----------
    data : bytes
        The file.
    tail : Tail
        Its end.
    check : callable
        Called before each step into another part of it.
    """
    begin = tail.begin + RECORD_HEAD.size
    crc = int.from_bytes(data[begin : begin + 4], "little")
    if tail.finished and crc and _sum(data, 0, tail.begin, check) != crc:
        why = "its check sum is wrong: what has none of its own may have been changed"
        yield Remark(tail.begin, begin + 4, "data section", why)
    if tail.trust in {Trust.VERIFIED, Trust.UNCHECKED}:
        yield from _of_offsets(data, begin + 4)


def _of_offsets(data: Bytes, start: int) -> Iterator[Remark]:
    """Yield where the summary offsets, which others read by, name other places than there are."""
    foot = len(data) - FOOTER_SIZE
    (at,) = struct.unpack_from("<Q", data, foot + RECORD_HEAD.size + 8)
    if not at:
        return
    spans = [(data[a], a, b) for a, b in _records(data, start, foot)]
    groups = {
        (op, rows[0][1], rows[-1][2] - rows[0][1])
        for op, rows in ((op, list(rows)) for op, rows in groupby(spans, lambda span: span[0]))
    }
    offsets = [
        _OFFSET.unpack_from(data, a + RECORD_HEAD.size)
        for op, a, b in spans
        if op == Op.SUMMARY_OFFSET and b - a == RECORD_HEAD.size + _OFFSET.size
    ]
    named = {one for one in offsets if one[2]}  # some writers name groups that are empty
    first = next((a for op, a, _ in spans if op == Op.SUMMARY_OFFSET), foot)
    if at != first or not named <= groups:
        yield Remark(at, foot, "summary offsets", "they name other places than there are")


def _records(data: Bytes, at: int, end: int) -> Iterator[tuple[int, int]]:
    """Yield begin and end of each record."""
    while at < end:
        stop = record_end(data, at, end)
        if stop is None:
            return
        yield at, stop
        at = stop
