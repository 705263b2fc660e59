# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Walk through a damaged MCAP file: find its chunks, and what lies between that cannot be read."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.io.mcap.damage import Loss, Salvage
from valve_twin.io.mcap.format import (
    MAGIC,
    RECORD_HEAD,
    Channel,
    ChunkIndex,
    Op,
    Schema,
    Statistics,
)
from valve_twin.io.mcap.summary import Summary
from valve_twin.io.salvage.chunk import Piece, Walk, read_heads, unpack, walk
from valve_twin.io.salvage.definitions import definitions_beside
from valve_twin.io.salvage.lost_counts import expected_counts, settle
from valve_twin.io.salvage.message_checks import Checks, Places, plausible
from valve_twin.io.salvage.records import (
    claimed_end,
    is_whole,
    may_follow,
    next_record,
    record_end,
)
from valve_twin.io.salvage.tail import Tail, Trust, read_tail

if TYPE_CHECKING:
    from pathlib import Path

    from valve_twin.io.salvage.records import Bytes

_MAX_LOOSE = 1 << 24


class Scan:
    """One walk through a file.

    Parameters
    ----------
    path : Path
        The file, for messages.
    data : bytes
        Its content.
    """

    def __init__(self, path: Path, data: Bytes) -> None:
        self._path, self._data = path, data
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
        self._lost_places: list[tuple[int, int]] = []

    def run(self) -> Salvage:
        """Walk the file and settle what is lost."""
        data = self._data
        if data[: len(MAGIC)] != MAGIC:
            self._flaw(0, min(len(MAGIC), len(data)), "opening mark", "is damaged")
        at = len(MAGIC)
        while at < self._end:
            at = self._step(at)
        self._end_loose(self._end)
        for offset, length, what, why in self._tail.flaws:
            self._flaw(offset, length, what, why)
        return self._settled()

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
        stop = claimed_end(data, at, end)
        if stop is not None and stop > at and may_follow(data, stop, end):
            self._end_loose(at)
            self._odd(op, at, stop)
            return stop
        return self._gap(at)

    def _is_chunk(self, at: int) -> bool:
        """Return whether a chunk stands here, perhaps under another opcode."""
        own = self._data[at]
        if own == Op.CHUNK:
            heads = read_heads(self._data, at, self._end)
            if self._chunked or any(head.agrees for head in heads):
                return True
            return unpack(self._data, at, self._end).verified
        if own <= Op.DATA_END and record_end(self._data, at, self._end) is not None:
            return False
        return record_end(self._data, at, self._end, op=Op.CHUNK) is not None

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
            except ValueError:
                self._flaw(at, stop - at, "definition", "cannot be read")

    def _odd(self, op: int, at: int, stop: int) -> None:
        """Pass a record whose contents deny its kind."""
        if op == Op.MESSAGE or not self._chunked:
            self._lose(at, stop, "message", "its head is damaged", None)
        else:
            self._flaw(at, stop - at, _KINDS.get(op, "record"), "its contents are damaged")

    def _gap(self, at: int) -> int:
        """Pass bytes in which no record begins."""
        self._end_loose(at)
        kinds = _NO_MESSAGE if self._chunked else _ANY
        found = next_record(self._data, at + 1, self._end, kinds=kinds)
        hinted = min((o for o in self._hints if o > at), default=self._end)
        stop = min(self._end if found is None else found, hinted)
        if stop == self._end and not self._tail.finished and self._tail.trust is Trust.MISSING:
            self._lose(at, stop, "record", "the file ends in it", None)
        elif self._data[at] in _KINDS:
            self._flaw(at, stop - at, _KINDS[self._data[at]], "its length is damaged")
        else:
            self._lose(at, stop, "records", "they cannot be read", None)
        return stop

    # -- chunks

    def _chunk(self, at: int) -> int:
        data, end = self._data, self._end
        self._chunked = True
        hint = self._hints.get(at)
        got = unpack(data, at, end, hint)
        stop = got.end if got.end is not None else self._after_chunk(at, hint)
        found = walk(got.records)
        if got.verified or got.plain or got.records:
            kept = None if got.plain and (got.verified or found.whole) else got.records
            self._pieces.append(Piece(at, stop - at, got.verified, kept, found, len(got.records)))
            if got.reason:
                count = 0 if got.verified else None
                self._chunk_loss(at, stop, got.reason, hint, count)
        else:
            self._pieces.append(Piece(at, stop - at, False, b"", found, 0))
            self._chunk_loss(at, stop, got.reason or "it cannot be unpacked", hint, None)
        return stop

    def _after_chunk(self, at: int, hint: ChunkIndex | None) -> int:
        """Return where a chunk ends that cannot be unpacked."""
        data, end = self._data, self._end
        told = [head.end for head in read_heads(data, at, end)]
        told += [h.packed_at + h.packed for h in read_heads(data, at, end)]
        if hint is not None:
            told.insert(0, at + hint.length)
        for stop in told:
            if at + RECORD_HEAD.size < stop <= end and may_follow(data, stop, end):
                return stop
        found = next_record(data, at + 1, end, kinds=_NO_MESSAGE)
        hinted = min((o for o in self._hints if o > at), default=end)
        return min(end if found is None else found, hinted)

    def _chunk_loss(
        self, at: int, stop: int, reason: str, hint: ChunkIndex | None, count: int | None
    ) -> None:
        if count == 0:
            self._flaw(at, stop - at, "chunk", reason)
            return
        heads = read_heads(self._data, at, self._end)
        start_ns, end_ns = None, None
        if hint is not None:
            start_ns, end_ns = hint.start_ns, hint.end_ns
        elif heads and heads[0].start_ns <= heads[0].end_ns:
            start_ns, end_ns = heads[0].start_ns, heads[0].end_ns
        self._lost_places.append((len(self._losses), len(self._pieces) - 1))
        self._losses.append(
            Loss(
                self._path,
                at,
                stop - at,
                "chunk",
                reason,
                start_ns=start_ns,
                end_ns=end_ns,
                count=None,
            )
        )

    # -- messages outside chunks

    def _end_loose(self, at: int) -> None:
        """Keep the messages outside chunks that end here as a piece."""
        begin, self._loose_from = self._loose_from, None
        if begin is not None:
            records = bytes(self._data[begin:at])
            self._pieces.append(
                Piece(begin, at - begin, False, records, walk(records), len(records))
            )

    # -- what is lost

    def _flaw(self, at: int, length: int, what: str, why: str) -> None:
        self._losses.append(Loss(self._path, at, length, what, why))

    def _lose(self, at: int, stop: int, what: str, why: str, count: int | None) -> None:
        self._losses.append(Loss(self._path, at, stop - at, what, why, count=count))

    def _settled(self) -> Salvage:
        copies, channels = self._definitions()
        self._adopt(copies, channels)
        checks = Checks(copies, channels, str(self._path))
        rescued: dict[int, bytes] = {}
        unverified: dict[int, int] = {}
        kept: list[Piece] = []
        for number, piece in enumerate(self._pieces):
            if not piece.verified:
                self._check(piece, checks)
            self._complete_loss(number, piece, channels)
            if not piece.found.counts:
                continue
            if not piece.verified:
                unverified[piece.offset] = piece.found.messages
            if piece.records is not None:
                rescued[piece.offset] = piece.records
            kept.append(piece)
        counts: dict[int, int] = {}
        for piece in kept:
            for channel, n in piece.found.counts.items():
                counts[channel] = counts.get(channel, 0) + n
        schemas = {i: found[0] for i, found in copies.items()}
        used = {i: c for i, c in channels.items() if c.schema_id in schemas or not c.schema_id}
        statistics = Statistics(
            sum(n for i, n in counts.items() if i in used),
            min((p.found.start_ns for p in kept), default=0),
            max((p.found.end_ns for p in kept), default=0),
            len(kept),
            {i: counts.get(i, 0) for i in used},
        )
        orphans = {i: n for i, n in counts.items() if i not in used}
        if orphans:
            why = f"no definition is left of channels {', '.join(map(str, sorted(orphans)))}"
            self._lose(0, 0, "topics", why, sum(orphans.values()))
        summary = Summary(
            schemas, used, [self._chunk_index(p) for p in kept], statistics, self._outside.metadata
        )
        expected = expected_counts(self._path, self._tail, statistics, used, len(self._pieces))
        losses, lost, total = settle(
            self._path, self._losses, statistics, used, expected, self._tail, len(self._data)
        )
        return Salvage(
            self._path,
            summary,
            rescued,
            losses,
            unverified,
            checks.suspects,
            lost,
            total,
        )

    def _definitions(self) -> tuple[dict[int, list[Schema]], dict[int, Channel]]:
        """Return schemas with their other copies, and channels; what is verified wins."""
        verified = [p.found for p in self._pieces if p.verified]
        other = [p.found for p in self._pieces if not p.verified]
        own = self._tail.summary
        last = [own] if self._tail.trust is not Trust.VERIFIED else []
        first = [] if last else [own]
        schemas: dict[int, list[Schema]] = {}
        topics: dict[int, list[Channel]] = {}
        sources: tuple[Summary | Walk, ...] = (*first, *verified, self._outside, *last, *other)
        for source in sources:
            for i, schema in source.schemas.items():
                copies = schemas.setdefault(i, [])
                if schema not in copies:
                    copies.append(schema)
            for i, channel in source.channels.items():
                topics.setdefault(i, []).append(channel)
        sound: tuple[Summary | Walk, ...] = (*verified, *first)
        channels = {i: c for source in sound for i, c in source.channels.items()}
        for i, copied in topics.items():
            likeliest = _likeliest(copied, set(schemas))
            channels.setdefault(i, likeliest)
            for channel in copied:
                if channel != channels[i]:
                    self._differ(channels[i], channel)
        return schemas, channels

    def _adopt(self, copies: dict[int, list[Schema]], channels: dict[int, Channel]) -> None:
        """Take what is missing of the definitions from other files of the bag."""
        held = {i for p in self._pieces if p.verified for i in p.found.counts}
        missing = held - set(channels)
        if not missing:
            return
        found, schemas = definitions_beside(self._path, missing, channels)
        # a number that stands for another schema here must not be mistaken
        for i, channel in found.items():
            number = channel.schema_id
            if number in copies and schemas[number] not in copies[number]:
                continue
            copies.setdefault(number, [schemas[number]])
            channels[i] = channel
            why = "its definition is lost; that of another file of the bag is used"
            self._flaw(0, 0, f"topic '{channel.topic}'", why)

    def _differ(self, used: Channel, other: Channel) -> None:
        """Say that two copies of a topic differ."""
        why = f"its copies differ: '{used.topic}' is used, not '{other.topic}'"
        loss = Loss(self._path, 0, 0, "topic", why)
        if loss not in self._losses:
            self._losses.append(loss)

    def _check(self, piece: Piece, checks: Checks) -> None:
        """Keep only plausible messages of a piece that no check sum stands for."""
        records = piece.records
        if records is None:
            records = unpack(self._data, piece.offset, self._end).records
        heads = read_heads(self._data, piece.offset, self._end)
        hint = self._hints.get(piece.offset)
        span = None
        if self._data[piece.offset] != Op.MESSAGE:
            span = (heads[0].start_ns, heads[0].end_ns) if heads else None
            if hint is not None:  # of two spans without check sum the wider is believed
                first, last = span or (hint.start_ns, hint.end_ns)
                span = (min(first, hint.start_ns), max(last, hint.end_ns))
        places = Places.read(self._data, piece.index, self._end)
        sound = plausible(records, checks, places, span)
        if len(sound) == len(records):
            return
        before = piece.found
        piece.records = sound
        piece.found = walk(sound)
        held = places.counts or (before.counts if before.whole else {})
        dropped = {
            i: n - piece.found.counts.get(i, 0)
            for i, n in held.items()
            if n > piece.found.counts.get(i, 0)
        }
        if not any(loss.offset == piece.offset and loss.count is None for loss in self._losses):
            known = all(map(checks.knows, dropped))
            names = {checks.topic(i): n for i, n in dropped.items()} if known else {}
            self._losses.append(
                Loss(
                    self._path,
                    piece.offset,
                    piece.length,
                    "messages without check sum",
                    "they are not plausible and were left out",
                    topics=tuple(sorted(names)),
                    start_ns=before.start_ns if span is None else span[0],
                    end_ns=before.end_ns if span is None else span[1],
                    count=sum(dropped.values()) or None,
                    counts=names,
                )
            )

    def _chunk_index(self, piece: Piece) -> ChunkIndex:
        found = piece.found
        heads = read_heads(self._data, piece.offset, self._end)
        is_chunk = self._data[piece.offset] == Op.CHUNK and heads
        return ChunkIndex(
            found.start_ns,
            found.end_ns,
            piece.offset,
            piece.length,
            dict.fromkeys(found.counts, 0),
            0,
            heads[0].compression if is_chunk else "",
            piece.length,
            piece.size if piece.records is None else len(piece.records),
        )

    def _complete_loss(self, number: int, piece: Piece, channels: dict[int, Channel]) -> None:
        """Count what a damaged chunk held by the index records behind it or by the summary."""
        for place, owner in self._lost_places:
            if owner != number:
                continue
            loss = self._losses[place]
            hint = self._hints.get(piece.offset)
            places = Places.read(self._data, piece.index, self._end)
            if hint is not None and not piece.index:
                places = Places.read(self._data, dict(hint.message_indexes), self._end)
            held = set(piece.index) | (set(hint.message_indexes) if hint is not None else set())
            complete = bool(places.counts) and (
                hint is None or set(places.counts) >= set(hint.message_indexes)
            )
            counts = {i: n - piece.found.counts.get(i, 0) for i, n in places.counts.items()}
            names = {channels[i].topic: n for i, n in counts.items() if i in channels and n > 0}
            topics = sorted({channels[i].topic for i in held if i in channels} & set(names)) or [
                channels[i].topic for i in sorted(held) if i in channels
            ]
            self._losses[place] = Loss(
                loss.file,
                loss.offset,
                loss.length,
                loss.what,
                loss.reason,
                tuple(topics),
                loss.start_ns,
                loss.end_ns,
                sum(max(n, 0) for n in counts.values()) if complete else None,
                names if complete else {},
            )


def _likeliest(copies: list[Channel], schemas: set[int]) -> Channel:
    """Return of the copies of a topic that with a known type, and of these the most frequent."""
    return max(copies, key=lambda channel: (channel.schema_id in schemas, copies.count(channel)))


_KINDS = {
    int(Op.HEADER): "file header",
    int(Op.SCHEMA): "definition",
    int(Op.CHANNEL): "topic",
    int(Op.MESSAGE_INDEX): "message index",
    int(Op.METADATA): "metadata",
    0x09: "attachment",
    int(Op.DATA_END): "end of data",
}
_NO_MESSAGE = frozenset({*_KINDS, int(Op.CHUNK)})
_ANY = _NO_MESSAGE | {int(Op.MESSAGE)}
