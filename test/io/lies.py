# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Bags that lie consistently: taken apart, changed in places that agree, and sealed anew.

Mutated bytes hardly ever make a false statement that all check sums and lengths confirm. Here a
bag is a list of chunks and records. What indexes, statistics and summary say of it is made from
the truth, from another state of the bag, or wrong on purpose; whatever it is, every length and
check sum of the file holds. A statement is a lie where the file differs from the one that is
written of the same data section with nothing but the truth.
"""

from __future__ import annotations

import copy
import struct
import zlib
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import lz4.frame
import zstandard

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, INDEX, CHUNK_INDEX = range(1, 9)
ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, METADATA, METADATA_INDEX = range(9, 14)
SUMMARY_OFFSET, DATA_END = 14, 15


class Said(NamedTuple):
    """One message of a file; times in ns."""

    channel: int
    sequence: int
    log_ns: int
    publish_ns: int
    data: bytes


class Record(NamedTuple):
    """One record outside chunks, as it stands there."""

    op: int
    body: bytes


@dataclass(slots=True)
class Chunk:
    """One chunk.

    Attributes
    ----------
    defined : list of Record
        Schemas and channels in it.
    messages : list of Said
        In their order.
    packed : str
        Its compression.
    span : (int, int), optional
        First and last log time that its head and index state [ns], None = the true ones.
    indexed : list of Said, optional
        What the message indexes behind it are made of, None = its messages.
    late : Record, optional
        A definition behind its first message.
    """

    defined: list[Record]
    messages: list[Said]
    packed: str = "zstd"
    span: tuple[int, int] | None = None
    indexed: list[Said] | None = None
    late: Record | None = None

    @property
    def times(self) -> tuple[int, int]:
        """First and last log time of its messages [ns]."""
        logs = [m.log_ns for m in self.messages]
        return (min(logs), max(logs)) if logs else (0, 0)


@dataclass(slots=True)
class Known:
    """What a summary may say of one chunk."""

    start_ns: int
    end_ns: int
    at: int
    length: int
    indexes: dict[int, int]
    index_length: int
    packed: str
    packed_size: int
    size: int

    def record(self) -> bytes:
        """Return it as a record."""
        offsets = b"".join(struct.pack("<HQ", *item) for item in sorted(self.indexes.items()))
        body = struct.pack("<QQQQ", self.start_ns, self.end_ns, self.at, self.length)
        body += struct.pack("<I", len(offsets)) + offsets + struct.pack("<Q", self.index_length)
        body += text(self.packed) + struct.pack("<QQ", self.packed_size, self.size)
        return record(CHUNK_INDEX, body)


@dataclass(slots=True)
class Counts:
    """What statistics may say of a file."""

    total: int = 0
    start_ns: int = 0
    end_ns: int = 0
    chunks: int = 0
    by_channel: dict[int, int] = field(default_factory=dict)
    schemas: int = 0
    channels: int = 0
    attachments: int = 0
    metadata: int = 0

    def record(self) -> bytes:
        """Return it as a record."""
        counted = b"".join(struct.pack("<HQ", *item) for item in sorted(self.by_channel.items()))
        body = struct.pack("<QHIIII", self.total, self.schemas, self.channels, self.attachments,
                           self.metadata, self.chunks)  # fmt: skip
        body += struct.pack("<QQI", self.start_ns, self.end_ns, len(counted)) + counted
        return record(STATISTICS, body)


@dataclass(slots=True)
class Layout:
    """What a writer writes beside the messages."""

    sums: bool = True
    data_sum: bool = False
    indexes: bool = True
    known: bool = True
    counts: bool = True
    repeats: bool = True
    offsets: bool = True
    summary: bool = True


@dataclass(slots=True)
class Bag:
    """One file, taken apart.

    Attributes
    ----------
    items : list of Chunk, Record
        The data section in its order.
    layout : Layout
        What is written beside the messages.
    defined : list of Record
        Schemas and channels that the summary repeats; None = those of the data section.
    known, counts : optional
        What the summary states of the chunks and in its statistics; None = the truth.
    data_sum : int, optional
        Check sum of the data section that is stated; None = the true one.
    offset_turn : int
        By how many places the groups of the summary offsets are turned, 0 = the truth.
    footer : (int, int), optional
        Shifts of summary start and offset start, in records; None = the truth.
    before : bytes
        A summary of its own that stands before the true one.
    """

    items: list[Chunk | Record]
    layout: Layout = field(default_factory=Layout)
    defined: list[Record] | None = None
    known: list[Known] | None = None
    counts: Counts | None = None
    data_sum: int | None = None
    offset_turn: int = 0
    start_shift: int = 0
    before: bytes = b""

    @property
    def chunks(self) -> list[Chunk]:
        """Its chunks in their order."""
        return [i for i in self.items if isinstance(i, Chunk)]

    def copy(self) -> Bag:
        """Return one that can be changed."""
        bag = copy.copy(self)
        bag.items = [
            replace(i, defined=list(i.defined), messages=list(i.messages))
            if isinstance(i, Chunk)
            else i
            for i in self.items
        ]
        return bag

    def honest(self) -> Bag:
        """Return the same data section with nothing but the truth about it."""
        bag = Bag(self.copy().items, self.layout)
        for chunk in bag.chunks:
            chunk.span = chunk.indexed = None
        return bag

    def held(self) -> list[Said]:
        """Return the messages of the data section; a chunk that repeats another counts once."""
        found: list[Said] = []
        seen: set[bytes] = set()
        for item in self.items:
            if isinstance(item, Record):
                found += [said(item.body)] if item.op == MESSAGE else []
                continue
            whole = _chunk(item, self.layout.sums)[0]
            first, last = item.times
            if whole not in seen or first == last:
                found += item.messages
            seen.add(whole)
        return found

    def repeats(self) -> bool:
        """Return whether a chunk stands twice in it."""
        wholes = [_chunk(c, self.layout.sums)[0] for c in self.chunks]
        return len(set(wholes)) < len(wholes)


def record(op: int, body: bytes) -> bytes:
    """Return a record."""
    return struct.pack("<BQ", op, len(body)) + body


def text(value: str) -> bytes:
    """Return a text with its length."""
    data = value.encode()
    return struct.pack("<I", len(data)) + data


def said(body: bytes) -> Said:
    """Take the body of a message apart."""
    channel, sequence, log_ns, publish_ns = struct.unpack_from("<HIQQ", body)
    return Said(channel, sequence, log_ns, publish_ns, body[22:])


def spoken(m: Said) -> bytes:
    """Return a message as the body of its record."""
    return struct.pack("<HIQQ", m.channel, m.sequence, m.log_ns, m.publish_ns) + m.data


def records_of(data: bytes) -> Iterable[Record]:
    """Yield the records of a sound section."""
    at = 0
    while at < len(data):
        op, length = struct.unpack_from("<BQ", data, at)
        yield Record(op, data[at + 9 : at + 9 + length])
        at += 9 + length


def taken_apart(data: bytes) -> Bag:
    """Take a sound file apart."""
    items: list[Chunk | Record] = []
    for op, body in records_of(data[len(MAGIC) : -len(MAGIC)]):
        if op == DATA_END:
            break
        if op == CHUNK:
            (named,) = struct.unpack_from("<I", body, 28)
            packed, held = body[32 : 32 + named].decode(), body[40 + named :]
            inner = list(records_of(_unpacked(packed, held)))
            found = Chunk([], [], packed)
            found.defined = [r for r in inner if r.op != MESSAGE]
            found.messages = [said(r.body) for r in inner if r.op == MESSAGE]
            items.append(found)
        elif op not in {INDEX, HEADER}:
            items.append(Record(op, body))
    return Bag(items)


def _unpacked(packed: str, held: bytes) -> bytes:
    if packed == "zstd":
        return zstandard.ZstdDecompressor().decompress(held)
    return bytes(lz4.frame.decompress(held)) if packed == "lz4" else held


def _packed(kind: str, records: bytes) -> bytes:
    if kind == "zstd":
        return zstandard.ZstdCompressor().compress(records)
    return bytes(lz4.frame.compress(records)) if kind == "lz4" else records


def _chunk(chunk: Chunk, sums: bool) -> tuple[bytes, list[tuple[Said, int]], int, int]:
    """Return a chunk's record, the place of each message, its sizes unpacked and packed."""
    inside = b"".join(record(*one) for one in chunk.defined)
    places = []
    for m in chunk.messages:
        places.append((m, len(inside)))
        inside += record(MESSAGE, spoken(m))
        if chunk.late is not None and m is chunk.messages[0]:
            inside += record(*chunk.late)
    packed = _packed(chunk.packed, inside)
    start, end = chunk.span or chunk.times
    crc = zlib.crc32(inside) if sums else 0
    body = struct.pack("<QQQI", start, end, len(inside), crc) + text(chunk.packed)
    body += struct.pack("<Q", len(packed)) + packed
    return record(CHUNK, body), places, len(inside), len(packed)


def _indexes(entries: Sequence[tuple[Said, int]]) -> dict[int, bytes]:
    """Return the message index of each channel."""
    found: dict[int, bytes] = {}
    for m, place in entries:
        found[m.channel] = found.get(m.channel, b"") + struct.pack("<QQ", m.log_ns, place)
    return {
        i: record(INDEX, struct.pack("<HI", i, len(rows)) + rows)
        for i, rows in sorted(found.items())
    }


def _other_places(chunk: Chunk, places: list[tuple[Said, int]]) -> list[tuple[Said, int]]:
    """Return the entries of an index that was made of other messages."""
    assert chunk.indexed is not None
    own = [at for _, at in places]
    return [(m, own[n % len(own)] if own else 0) for n, m in enumerate(chunk.indexed)]


class Written(NamedTuple):
    """A file, and what its summary says if it says the truth."""

    data: bytes
    known: list[Known]
    counts: Counts
    summary: bytes


def written(bag: Bag) -> Written:
    """Put a file together; every length and check sum in it holds."""
    layout = bag.layout
    out = bytearray(MAGIC + record(HEADER, text("ros2") + text("test")))
    known: list[Known] = []
    totals, logs = Counter[int](), list[int]()
    defined: dict[tuple[int, int], Record] = {}
    places: dict[int, list[tuple[int, Record]]] = {ATTACHMENT: [], METADATA: []}
    for item in bag.items:
        if isinstance(item, Record):
            if item.op in places:
                places[item.op].append((len(out), item))
            out += record(*item)
            if item.op == MESSAGE:
                totals[said(item.body).channel] += 1
                logs.append(said(item.body).log_ns)
            elif item.op in {SCHEMA, CHANNEL}:
                defined.setdefault((item.op, int.from_bytes(item.body[:2], "little")), item)
            continue
        at = len(out)
        whole, entries, size, packed_size = _chunk(item, layout.sums)
        out += whole
        begin, indexes = len(out), dict[int, int]()
        if layout.indexes:
            stated = entries if item.indexed is None else _other_places(item, entries)
            for channel, one in _indexes(stated).items():
                indexes[channel] = len(out)
                out += one
        span = item.span or item.times
        known.append(
            Known(*span, at, len(whole), indexes, len(out) - begin, item.packed, packed_size, size)
        )
        for row in item.defined:
            defined.setdefault((row.op, int.from_bytes(row.body[:2], "little")), row)
        totals.update(m.channel for m in item.messages)
        logs += [m.log_ns for m in item.messages]
    counts = Counts(
        totals.total(), min(logs, default=0), max(logs, default=0), len(known), dict(totals),
        sum(op == SCHEMA for op, _ in defined), sum(op == CHANNEL for op, _ in defined),
        len(places[ATTACHMENT]), len(places[METADATA]),
    )  # fmt: skip
    crc = bag.data_sum
    if crc is None:
        crc = zlib.crc32(out) if layout.data_sum else 0
    out += record(DATA_END, struct.pack("<I", crc)) + bag.before
    return Written(*_closed(bag, out, known, counts, list(defined.values()), places))


def _closed(
    bag: Bag,
    out: bytearray,
    known: list[Known],
    counts: Counts,
    defined: list[Record],
    places: dict[int, list[tuple[int, Record]]],
) -> tuple[bytes, list[Known], Counts, bytes]:
    """Add summary and footer."""
    layout, start = bag.layout, len(out)
    if bag.defined is not None:
        defined = bag.defined
    groups: list[tuple[int, bytes]] = []
    if layout.repeats:
        groups = [
            (op, b"".join(record(*r) for r in defined if r.op == op)) for op in (SCHEMA, CHANNEL)
        ]
    if layout.counts:
        groups.append((STATISTICS, (counts if bag.counts is None else bag.counts).record()))
    if layout.known:
        rows = known if bag.known is None else bag.known
        groups.append((CHUNK_INDEX, b"".join(k.record() for k in rows)))
        groups.append((ATTACHMENT_INDEX, b"".join(map(_attachment_index, *_columns(places)))))
        groups.append((METADATA_INDEX, b"".join(_metadata_index(*p) for p in places[METADATA])))
    groups = [g for g in groups if g[1]] if layout.summary else []
    spots, firsts = [], []
    for op, rows_of in groups:
        spots.append((op, len(out), len(rows_of)))
        firsts += [len(out) + n for n in _begins(rows_of)]
        out += rows_of
    offsets_at = len(out) if layout.offsets and groups else 0
    turned = spots[bag.offset_turn :] + spots[: bag.offset_turn] if spots else []
    for (op, *_), (_, at, length) in zip(spots if offsets_at else (), turned, strict=False):
        out += record(SUMMARY_OFFSET, struct.pack("<BQQ", op, at, length))
    summary = bytes(out[start:])
    begin = start if groups else 0
    if bag.start_shift and groups:
        begin = firsts[min(bag.start_shift, len(firsts) - 1)]
    foot = struct.pack("<BQQQ", FOOTER, 20, begin, offsets_at)
    crc = zlib.crc32(bytes(out[begin:] if begin else b"") + foot) if layout.sums and begin else 0
    out += foot + struct.pack("<I", crc) + MAGIC
    return bytes(out), known, counts, summary


def _begins(rows: bytes) -> list[int]:
    found, at = [], 0
    while at < len(rows):
        found.append(at)
        at += 9 + struct.unpack_from("<Q", rows, at + 1)[0]
    return found


def _columns(
    places: dict[int, list[tuple[int, Record]]],
) -> tuple[list[int], list[Record]]:
    own = places[ATTACHMENT]
    return [at for at, _ in own], [one for _, one in own]


def _attachment_index(at: int, one: Record) -> bytes:
    log_ns, made_ns, named = struct.unpack_from("<QQI", one.body)
    name = one.body[20 : 20 + named].decode()
    (typed,) = struct.unpack_from("<I", one.body, 20 + named)
    kind = one.body[24 + named : 24 + named + typed].decode()
    (size,) = struct.unpack_from("<Q", one.body, 24 + named + typed)
    body = struct.pack("<QQQQQ", at, 9 + len(one.body), log_ns, made_ns, size)
    return record(ATTACHMENT_INDEX, body + text(name) + text(kind))


def _metadata_index(at: int, one: Record) -> bytes:
    (named,) = struct.unpack_from("<I", one.body)
    name = one.body[4 : 4 + named].decode()
    return record(METADATA_INDEX, struct.pack("<QQ", at, 9 + len(one.body)) + text(name))


def attachment(name: str, data: bytes, log_ns: int, crc: int | None = None) -> Record:
    """Return an attachment; `crc` is the check sum that it states, None = the true one."""
    body = struct.pack("<QQ", log_ns, log_ns) + text(name) + text("application/octet-stream")
    body += struct.pack("<Q", len(data)) + data
    return Record(ATTACHMENT, body + struct.pack("<I", zlib.crc32(body) if crc is None else crc))


def remapped(one: Record, numbers: dict[int, int]) -> Record:
    """Return a channel under another number; anything else as it is."""
    if one.op != CHANNEL:
        return one
    own = int.from_bytes(one.body[:2], "little")
    return Record(CHANNEL, struct.pack("<H", numbers.get(own, own)) + one.body[2:])


def renumbered(m: Said, numbers: dict[int, int]) -> Said:
    """Return a message on another channel."""
    return m._replace(channel=numbers.get(m.channel, m.channel))


def moved(known: Known, at: int) -> Known:
    """Return what is known of a chunk that stands at another place."""
    by = at - known.at
    return replace(known, at=at, indexes={i: p + by for i, p in known.indexes.items()})
