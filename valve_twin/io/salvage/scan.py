# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Walk through a damaged MCAP file: find its chunks, and what lies between that cannot be read."""

from __future__ import annotations

import struct
from collections import Counter
from typing import TYPE_CHECKING

from valve_twin.io.mcap.damage import Loss, Salvage
from valve_twin.io.mcap.format import MAGIC, RECORD_HEAD, ChunkIndex, Op, Statistics
from valve_twin.io.mcap.mapped import STRIDE
from valve_twin.io.mcap.summary import Summary
from valve_twin.io.salvage.agreement import of_attachment, of_chunk, of_summary, of_sums
from valve_twin.io.salvage.chunk import read_heads, unpack
from valve_twin.io.salvage.definitions import Definitions
from valve_twin.io.salvage.lost_counts import settle
from valve_twin.io.salvage.message_checks import Checks, Places, plausible
from valve_twin.io.salvage.piece import Piece
from valve_twin.io.salvage.records import (
    claimed_end,
    is_whole,
    may_follow,
    next_record,
    record_end,
)
from valve_twin.io.salvage.tail import Tail, Trust, read_tail
from valve_twin.io.salvage.walk import walk

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from mcap.records import Channel

    from valve_twin.io.salvage.records import Bytes

_MAX_LOOSE = 1 << 24
_OF_SUMMARY = frozenset(
    {
        int(Op.STATISTICS),
        int(Op.CHUNK_INDEX),
        int(Op.ATTACHMENT_INDEX),
        int(Op.METADATA_INDEX),
        int(Op.SUMMARY_OFFSET),
        int(Op.FOOTER),
        int(Op.DATA_END),
    }
)
_KINDS = {
    int(Op.HEADER): "file header",
    int(Op.SCHEMA): "definition",
    int(Op.CHANNEL): "topic",
    int(Op.MESSAGE_INDEX): "message index",
    int(Op.METADATA): "metadata",
    int(Op.ATTACHMENT): "attachment",
    int(Op.DATA_END): "end of data",
}
_NO_MESSAGE = frozenset({*_KINDS, int(Op.CHUNK)})
_ANY = _NO_MESSAGE | {int(Op.MESSAGE)}


class Scan:
    """One walk through a file.

    Parameters
    ----------
    path : Path
        The file, for messages.
    data : bytes
        Its content.
    check : callable
        Called before each step into another part of it.
    """

    def __init__(
        self, path: Path, data: Bytes, check: Callable[[], object] = lambda: None
    ) -> None:
        self._path, self._data, self._check_whole = path, data, check
        self._tail: Tail = read_tail(data)
        self._end = self._tail.begin
        self._hints = {
            c.offset: c for c in self._tail.summary.chunks if len(MAGIC) <= c.offset < self._end
        }
        self._pieces: list[Piece] = []
        self._losses: list[Loss] = []
        self._loose_from: int | None = None
        self._chunked = bool(self._hints)
        self._outside = Summary()
        self._known: dict[tuple[int, ...], int] = {}
        self._repeats: Counter[int] = Counter()

    def run(self) -> Salvage:
        """Walk the file and settle what is lost."""
        data = self._data
        if data[: len(MAGIC)] != MAGIC:
            self._tell(0, min(len(MAGIC), len(data)), "opening mark", "is damaged")
        at, checked = len(MAGIC), 0
        while at < self._end:
            if at >= checked:
                self._check_whole()
                checked = at + STRIDE
            at = self._step(at)
        self._check_whole()
        self._end_loose(self._end)
        for offset, length, what, why in self._tail.flaws:
            self._tell(offset, offset + length, what, why)
        if not self._losses:  # else it is wrong for what was told
            for remark in of_sums(data, self._tail, self._check_whole):
                self._tell(*remark)
        return self._settled()

    def _tell(self, at: int, stop: int, what: str, why: str, count: int | None = 0) -> Loss:
        """Note a damaged place."""
        loss = Loss(self._path, at, stop - at, what, why, count=count)
        self._losses.append(loss)
        return loss

    # -- records

    def _step(self, at: int) -> int:
        """Take the record at a place; return where to go on."""
        data, end = self._data, self._end
        op = data[at]
        if at in self._hints or self._is_chunk(at):
            self._end_loose(at)
            return self._chunk(at)
        stop = record_end(data, at, end)
        if stop is not None and (op != Op.MESSAGE or is_whole(data, at, stop, end)):
            self._record(op, at, stop)
            return stop
        self._end_loose(at)
        stop = claimed_end(data, at, end)
        if stop is None or stop <= at or not may_follow(data, stop, end):
            return self._gap(at)
        if op == Op.MESSAGE or not self._chunked:
            self._tell(at, stop, "message", "its head is damaged", None)
        else:
            self._tell(at, stop, _KINDS.get(op, "record"), "its contents are damaged")
        return stop

    def _is_chunk(self, at: int) -> bool:
        """Return whether a chunk stands here, perhaps under another opcode."""
        data, end, own = self._data, self._end, self._data[at]
        if own == Op.CHUNK:
            if self._chunked or any(head.agrees for head in read_heads(data, at, end)):
                return True
            return unpack(data, at, end).verified
        if own <= Op.DATA_END and record_end(data, at, end) is not None:
            return False
        return record_end(data, at, end, op=Op.CHUNK) is not None

    def _record(self, op: int, at: int, stop: int) -> None:
        if op == Op.MESSAGE:
            if self._loose_from is not None and at - self._loose_from > _MAX_LOOSE:
                self._end_loose(at)
            if self._loose_from is None:
                self._loose_from = at
            return
        self._end_loose(at)
        if op == Op.MESSAGE_INDEX and self._pieces:
            channel = int.from_bytes(self._data[at + 9 : at + 11], "little")
            self._pieces[-1].index[channel] = at
        elif op in {Op.SCHEMA, Op.CHANNEL, Op.METADATA}:
            try:
                self._outside.add(op, self._data[at + RECORD_HEAD.size : stop])
            except (struct.error, ValueError):
                self._tell(at, stop, "definition", "cannot be read")
        elif op == Op.ATTACHMENT and (remark := of_attachment(self._data, at, stop)):
            self._tell(*remark)
        elif op in _OF_SUMMARY or (op == Op.HEADER and at != len(MAGIC)):
            self._tell(at, stop, "record", "it does not belong among the data and is passed over")

    def _gap(self, at: int) -> int:
        """Pass bytes in which no record begins."""
        stop = self._next_start(at, _NO_MESSAGE if self._chunked else _ANY)
        kind = _KINDS.get(self._data[at])
        if stop == self._end and not self._tail.finished and self._tail.trust is Trust.MISSING:
            self._tell(at, stop, "record", "the file ends in it", None)
        elif kind is not None:
            self._tell(at, stop, kind, "its length is damaged")
        else:
            self._tell(at, stop, "records", "they cannot be read", None)
        return stop

    def _next_start(self, at: int, kinds: frozenset[int]) -> int:
        """Return where the next record begins, or the next chunk that the summary knows."""
        found = next_record(self._data, at + 1, self._end, kinds=kinds)
        hinted = min((o for o in self._hints if o > at), default=self._end)
        return hinted if found is None else min(found, hinted)

    def _end_loose(self, at: int) -> None:
        """Keep the messages outside chunks that end here as a piece."""
        begin, self._loose_from = self._loose_from, None
        if begin is not None:
            self._check_whole()
            records = bytes(self._data[begin:at])
            self._pieces.append(
                Piece(begin, at - begin, False, records, walk(records), len(records))
            )

    # -- chunks

    def _chunk(self, at: int) -> int:
        self._chunked = True
        hint = self._hints.get(at)
        heads = read_heads(self._data, at, self._end)
        got = unpack(self._data, at, self._end, hint)
        stop = got.end
        if stop is None:
            stated = [head.end for head in heads] + [h.packed_at + h.packed for h in heads]
            stop = self._chunk_end(at, stated if hint is None else [at + hint.length, *stated])
        found = walk(got.records)
        kept = None if got.plain and (got.verified or found.whole) else got.records
        piece = Piece(at, stop - at, got.verified, kept, found, len(got.records))
        piece.head, piece.hint = heads[0] if heads else None, hint
        before = self._repeated(piece)
        if before is not None:
            self._tell(at, stop, "chunk", f"it repeats the one at byte {before}; it counts once")
            self._repeats += found.counts
            return stop
        self._pieces.append(piece)
        if not got.reason and found.whole:
            for remark in of_chunk(self._data, piece, got.records, self._end):
                self._tell(*remark)
        if got.verified and got.reason:
            self._tell(at, stop, "chunk", got.reason)
        elif got.reason or not (got.verified or got.plain or got.records):
            piece.loss = self._tell(at, stop, "chunk", got.reason or "it cannot be unpacked", None)
            piece.loss.start_ns, piece.loss.end_ns = piece.claimed
        return stop

    def _repeated(self, piece: Piece) -> int | None:
        """Return where the same bytes stood before as a chunk that spans some time."""
        found, head = piece.found, piece.head
        if head is None or found.start_ns >= found.end_ns or not found.whole:
            return None
        key = (head.crc, head.start_ns, head.size, piece.length)
        first = self._known.setdefault(key, piece.offset)
        same = self._data[first : first + piece.length]
        stop = piece.offset + piece.length
        return first if first != piece.offset and same == self._data[piece.offset : stop] else None

    def _chunk_end(self, at: int, stated: list[int]) -> int:
        """Return where a chunk that cannot be unpacked ends, as stated, else by what follows."""
        for stop in stated:
            if at + RECORD_HEAD.size < stop <= self._end and may_follow(
                self._data, stop, self._end
            ):
                return stop
        return self._next_start(at, _NO_MESSAGE)

    # -- what is lost

    def _settled(self) -> Salvage:
        verified = [p.found for p in self._pieces if p.verified]
        other = [p.found for p in self._pieces if not p.verified]
        known = Definitions.of(self._tail, verified, self._outside, other)
        known.adopt(self._path, {i for found in verified for i in found.counts})
        for what, why in known.notes:
            self._tell(0, 0, what, why)
        checks = Checks(known.copies, known.channels, str(self._path))
        for piece in self._pieces:
            self._check_whole()
            if not piece.verified:
                self._check(piece, checks, known.channels)
            self._complete_loss(piece, known.channels)
        kept = [p for p in self._pieces if p.found.counts]
        counts: Counter[int] = sum((p.found.counts for p in kept), Counter())
        schemas = {i: found[0] for i, found in known.copies.items()}
        used = {
            i: c for i, c in known.channels.items() if c.schema_id in schemas or not c.schema_id
        }
        statistics = Statistics(
            sum(n for i, n in counts.items() if i in used),
            min((p.found.start_ns for p in kept), default=0),
            max((p.found.end_ns for p in kept), default=0),
            len(kept),
            {i: counts[i] for i in used},
        )
        orphans = {i: n for i, n in counts.items() if i not in used}
        if orphans:
            why = f"no definition is left of channels {', '.join(map(str, sorted(orphans)))}"
            self._tell(0, 0, "topics", why, sum(orphans.values()))
        told = sum(loss.count != 0 for loss in self._losses)
        for remark in of_summary(self._tail, self._pieces, statistics, told):
            self._tell(*remark)
        self._forget_repeats(statistics.message_count)
        chunks = [self._chunk_index(p) for p in kept]
        losses, lost, total = settle(
            self._losses,
            self._tail,
            statistics,
            used,
            path=self._path,
            size=len(self._data),
            chunks=len(self._pieces),
        )
        return Salvage(
            self._path,
            Summary(schemas, used, chunks, statistics, self._outside.metadata),
            {p.offset: p.records for p in kept if p.records is not None},
            losses,
            {p.offset: p.found.counts.total() for p in kept if not p.verified},
            checks.suspects,
            lost,
            total,
        )

    def _forget_repeats(self, count: int) -> None:
        """Take off the summary's counts what stands in chunks that repeat another."""
        stated, more = self._tail.summary.statistics, self._repeats.total()
        if more and stated is not None and stated.message_count == count + more:
            stated.message_count = count
            stated.counts = dict(Counter(stated.counts) - self._repeats)

    def _check(self, piece: Piece, checks: Checks, channels: Mapping[int, Channel]) -> None:
        """Keep only plausible messages of a piece that no check sum stands for."""
        records = piece.records
        if records is None:
            records = unpack(self._data, piece.offset, self._end).records
        span = piece.span if self._data[piece.offset] != Op.MESSAGE else None
        places = Places.read(self._data, piece.index, self._end)
        if piece.found.whole and places.lie_about(records):
            places = Places()
        sound = plausible(records, checks, places, span)
        if len(sound) == len(records):
            return
        before, piece.records, piece.found = piece.found, sound, walk(sound)
        held = Counter(places.counts or (before.counts if before.whole else {}))
        dropped = held - piece.found.counts
        if any(loss.offset == piece.offset and loss.count is None for loss in self._losses):
            return
        why = "they are not plausible and were left out"
        stop = piece.offset + piece.length
        loss = self._tell(piece.offset, stop, "messages without check sum", why)
        loss.start_ns, loss.end_ns = span or (before.start_ns, before.end_ns)
        loss.count = dropped.total() or None
        if dropped.keys() <= channels.keys():
            loss.counts = {channels[i].topic: n for i, n in dropped.items()}
            loss.topics = tuple(sorted(loss.counts))

    def _complete_loss(self, piece: Piece, channels: Mapping[int, Channel]) -> None:
        """Count what a damaged chunk held by the index records behind it or by the summary."""
        loss = piece.loss
        if loss is None:
            return
        hinted = {} if piece.hint is None else dict(piece.hint.message_indexes)
        places = Places.read(self._data, piece.index or hinted, self._end)
        missing = Counter(places.counts) - piece.found.counts
        names = {channels[i].topic: n for i, n in missing.items() if i in channels}
        held = [channels[i].topic for i in sorted({*piece.index, *hinted}) if i in channels]
        loss.topics = tuple(sorted(set(held) & set(names)) or held)
        if places.counts and places.counts.keys() >= hinted.keys():
            loss.count, loss.counts = missing.total(), names

    def _chunk_index(self, piece: Piece) -> ChunkIndex:
        is_chunk = self._data[piece.offset] == Op.CHUNK and piece.head is not None
        return ChunkIndex(
            piece.found.start_ns,
            piece.found.end_ns,
            piece.offset,
            piece.length,
            dict.fromkeys(piece.found.counts, 0),
            0,
            piece.head.compression if is_chunk and piece.head else "",
            piece.length,
            piece.size if piece.records is None else len(piece.records),
        )
