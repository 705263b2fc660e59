# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What indexes and summary say otherwise than the data section, which is the truth."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, NamedTuple

from valve_twin.io.mcap.format import RECORD_HEAD, Op
from valve_twin.io.mcap.index_check import Flaw, find_flaw
from valve_twin.io.salvage.records import record_end
from valve_twin.io.salvage.tail import Trust

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from valve_twin.io.mcap.format import ChunkIndex, Statistics
    from valve_twin.io.salvage.piece import Piece
    from valve_twin.io.salvage.records import Bytes
    from valve_twin.io.salvage.tail import Tail


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
