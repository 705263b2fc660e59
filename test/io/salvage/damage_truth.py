# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Files of every kind with the truth of every byte and message in them, found another way."""

from __future__ import annotations

import io
import struct
import zlib
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import lz4.frame
import zstandard
from mcap.writer import CompressionType, Writer

from valve_twin.io.bags.definitions import definition
from valve_twin.io.bags.read import BagWriter
from valve_twin.io.cdr.codec import encode_series, encode_stamped
from valve_twin.io.cdr.signals import SERIES_TYPE, STAMPED_TYPE
from valve_twin.io.salvage.read import salvage_file, salvaged_messages

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np

START_NS = 1_577_836_800_000_000_000
TEXT_TYPE = "std_msgs/msg/String"
TOPICS = {
    "/press/position": STAMPED_TYPE,
    "/press/command": STAMPED_TYPE,
    "/press/batch": SERIES_TYPE,
    "/press/note": TEXT_TYPE,
}
CHANNEL, MESSAGE, CHUNK = 4, 5, 6
Key = tuple[str, int, int, bytes]


@dataclass(slots=True)
class Region:
    """One record of a sound file with its messages; `inner` gives their ends in the records."""

    op: int
    begin: int
    end: int
    messages: list[Key] = field(default_factory=list)
    inner: list[int] = field(default_factory=list)
    crc: bool = False
    compression: str = ""
    packed_at: int = 0


@dataclass(slots=True)
class Truth:
    """A sound file and what is in it."""

    kind: str
    data: bytes
    regions: list[Region]
    has_metadata: bool = False
    summary_crc: bool = True

    @property
    def messages(self) -> Counter[Key]:
        """All messages."""
        return Counter(m for r in self.regions for m in r.messages)

    @property
    def data_end(self) -> int:
        """Where the data section ends."""
        return next(r.begin for r in self.regions if r.op == 0x0F)


def text_message(text: str) -> bytes:
    data = text.encode() + b"\0"
    return b"\0\1\0\0" + struct.pack("<I", len(data)) + data


def stream_of(rng: np.random.Generator, count: int) -> list[tuple[str, bytes, int]]:
    """Return messages: topic, bytes, log time."""
    found = []
    for i in range(count):
        at = START_NS + i * 10_000_000
        found.append(("/press/position", encode_stamped(at, float(rng.normal())), at))
        found.append(("/press/command", encode_stamped(at, float(rng.normal()), "plc"), at + 1))
        if i % 5 == 0:
            values = rng.normal(size=int(rng.integers(1, 20)))
            found.append(("/press/batch", encode_series(at, 0.01, values), at + 2))
        if i % 11 == 0:
            found.append(("/press/note", text_message(f"cycle {i}"), at + 3))
    return found


def written(kind: str, rng: np.random.Generator, folder: Path, count: int) -> Truth:
    """Write a file of a kind: "ours", or compression, check sum and chunk size."""
    messages = stream_of(rng, count)
    if kind == "ours":
        with BagWriter(folder / "bag", chunk_size=4000) as bag:
            for name, type_name in TOPICS.items():
                bag.add_topic(name, type_name)
            for name, data, at in messages:
                bag.write(name, data, log_ns=at)
        raw = (folder / "bag" / "bag_0.mcap").read_bytes()
        return Truth(kind, raw, regions(raw), has_metadata=True)
    compression, crc, size = kind.split("-")
    stream = io.BytesIO()
    names = {"zstd": "ZSTD", "lz4": "LZ4", "none": "NONE", "loose": "NONE"}
    writer = Writer(
        stream,
        chunk_size=int(size),
        compression=CompressionType[names[compression]],
        use_chunking=compression != "loose",
        enable_crcs=crc == "crc",
        enable_data_crcs=crc == "crc",
    )
    writer.start("ros2", "test")
    channels = {}
    for name, type_name in TOPICS.items():
        schema = writer.register_schema(type_name, "ros2msg", definition(type_name).encode())
        channels[name] = writer.register_channel(name, "cdr", schema)
    for name, data, at in messages:
        writer.add_message(channels[name], at, data, at)
    writer.finish()
    raw = stream.getvalue()
    return Truth(kind, raw, regions(raw), summary_crc=crc == "crc")


def unpacked(compression: str, packed: bytes) -> bytes:
    if compression == "zstd":
        return zstandard.ZstdDecompressor().decompressobj().decompress(packed)
    if compression == "lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed))
    return packed


def regions(data: bytes) -> list[Region]:
    """Walk a sound file."""
    found = []
    topics: dict[int, str] = {}
    at = 8
    while at < len(data) - 8:
        op, length = struct.unpack_from("<BQ", data, at)
        one = Region(op, at, at + 9 + length)
        if op == CHUNK:
            crc, named = struct.unpack_from("<II", data, at + 33)
            one.compression = data[at + 41 : at + 41 + named].decode()
            one.packed_at = at + 41 + named + 8
            one.crc = crc != 0
            records = unpacked(one.compression, data[one.packed_at : one.end])
            assert not crc or zlib.crc32(records) == crc
            _walk(records, 0, len(records), topics, one)
        else:
            _walk(data, at, one.end, topics, one)
        found.append(one)
        at = one.end
    return found


def _walk(data: bytes, at: int, end: int, topics: dict[int, str], into: Region) -> None:
    while at < end:
        op, length = struct.unpack_from("<BQ", data, at)
        if op == 4:
            number, _, named = struct.unpack_from("<HHI", data, at + 9)
            topics[number] = data[at + 17 : at + 17 + named].decode()
        if op == MESSAGE:
            channel, _, log_ns, publish_ns = struct.unpack_from("<HIQQ", data, at + 9)
            body = data[at + 31 : at + 9 + length]
            into.messages.append((topics[channel], log_ns, publish_ns, body))
            into.inner.append(at + 9 + length)
        at += 9 + length


@dataclass(slots=True)
class Tally:
    """What a campaign counted."""

    cases: int = 0
    intact: int = 0
    intact_found: int = 0
    cut_found: int = 0
    wrong_checked: int = 0
    wrong_unchecked: int = 0
    wrong_unchecked_unmarked: int = 0
    exact_counts: int = 0
    unknown_counts: int = 0
    false_counts: int = 0
    untold: int = 0

    def add(self, other: Tally) -> None:
        for name in self.__dataclass_fields__:
            setattr(self, name, getattr(self, name) + getattr(other, name))


def salvaged(path: Path, data: bytes):
    """Write damaged bytes, salvage them; return what was found and its report."""
    path.write_bytes(data)
    found = salvage_file(path)
    names = {i: c.topic for i, c in found.summary.channels.items()}
    messages = [
        ((names[m.channel], m.log_ns, m.publish_ns, m.data), verified)
        for m, verified in salvaged_messages(path, found)
    ]
    return found, messages


def judge_cut(truth: Truth, path: Path, size: int) -> Tally:
    """Cut a file and compare with the truth; raise AssertionError where the promise is broken."""
    found, messages = salvaged(path, truth.data[:size])
    must: Counter[Key] = Counter()
    checked: Counter[Key] = Counter()
    torn: Counter[Key] = Counter()
    for region in truth.regions:
        if region.end <= size:
            must.update(region.messages)
            checked.update(region.messages if region.crc else ())
        elif region.op == CHUNK and region.packed_at < size:
            whole = len(unpacked(region.compression, truth.data[region.packed_at : size]))
            torn.update(
                m for m, end in zip(region.messages, region.inner, strict=True) if end <= whole
            )
    got = Counter(m for m, _ in messages)
    assert got == must + torn, (truth.kind, size)
    assert Counter(m for m, verified in messages if verified) == checked
    tally = Tally(cases=1, intact=must.total(), intact_found=(got & must).total())
    tally.cut_found = torn.total()
    _judge_report(truth, found, got, tally, size, summary_gone=size < truth.data_end + 13)
    return tally


def judge_flip(truth: Truth, path: Path, place: int, flip: int) -> Tally:
    """Flip bits of a byte and compare with the truth."""
    data = bytearray(truth.data)
    data[place] ^= flip
    found, messages = salvaged(path, bytes(data))
    hit = next((r for r in truth.regions if r.begin <= place < r.end), None)
    hit_messages = Counter(hit.messages) if hit is not None and hit.messages else Counter()
    if hit is not None and hit.op == CHANNEL and not truth.summary_crc:
        # of two copies of a topic without check sum nobody can say which is right: it is told
        return _judge_topic(truth, found, [m for m, _ in messages], (place, flip))
    must = truth.messages - hit_messages
    got = Counter(m for m, _ in messages)
    tally = Tally(cases=1, intact=must.total(), intact_found=(got & must).total())
    assert not must - got, (truth.kind, place, flip, len(must - got))
    wrong = got - truth.messages
    checked = hit is not None and hit.crc
    unmarked = Counter(m for m, verified in messages if verified) - truth.messages
    tally.wrong_checked = wrong.total() if checked else 0
    tally.wrong_unchecked = 0 if checked else wrong.total()
    tally.wrong_unchecked_unmarked = unmarked.total()
    assert not tally.wrong_checked, (truth.kind, place, flip)
    assert not unmarked, (truth.kind, place, flip)
    if got != truth.messages and not wrong:
        tally.untold = int(not found.losses)
        assert found.losses, (truth.kind, place, flip)
    _judge_report(truth, found, got, tally, place, summary_gone=place >= truth.data_end)
    return tally


def _judge_topic(truth: Truth, found, got: list[Key], case: tuple[int, int]) -> Tally:
    same = Counter(m[1:] for m in got) == Counter(m[1:] for m in truth.messages.elements())
    assert same, (truth.kind, case)
    if Counter(got) != truth.messages:
        assert any(loss.what == "topic" for loss in found.losses), (truth.kind, case)
    count = len(got)
    return Tally(cases=1, intact=count, intact_found=count, exact_counts=1)


def _judge_report(truth, found, got, tally: Tally, place: int, *, summary_gone: bool) -> None:
    """What is said of losses is true: count, place, topics and times."""
    lost = truth.messages.total() - got.total()
    if found.lost_count is None:
        tally.unknown_counts = 1
        assert summary_gone, (truth.kind, place, "unknown")
        assert not truth.has_metadata, (truth.kind, place, "unknown")
    else:
        tally.exact_counts = 1
        tally.false_counts = int(found.lost_count != lost)
        assert found.lost_count == lost, (truth.kind, place, found.lost_count, lost)
    if not lost:
        return
    missing = truth.messages - got
    telling = [loss for loss in found.losses if loss.count != 0]
    assert telling, (truth.kind, place)
    assert any(loss.offset <= place <= loss.offset + loss.length for loss in telling)
    named = {name for loss in telling for name in loss.topics}
    fewer = Counter(m[0] for m in truth.messages.elements()) - Counter(
        m[0] for m in got.elements()
    )
    assert not named or set(fewer) <= named, (truth.kind, place, named)
    if len(telling) == 1 and not got - truth.messages:
        loss = telling[0]
        assert loss.start_ns is None or loss.start_ns <= min(m[1] for m in missing)
        assert loss.end_ns is None or loss.end_ns >= max(m[1] for m in missing)
