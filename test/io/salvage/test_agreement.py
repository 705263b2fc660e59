# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The data section is the truth: whatever indexes and summary say, nothing is lost untold."""

import struct
import zlib
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

from test.io import lies
from test.io.salvage.damage_truth import TOPICS, written
from valve_twin.cli import main
from valve_twin.io.bags.contents import bag_info
from valve_twin.io.bags.read import read_columns
from valve_twin.io.bags.report import bag_report
from valve_twin.io.cdr.signals import SignalSource
from valve_twin.io.mcap import reader
from valve_twin.io.offline.cut import cut
from valve_twin.io.playback.player import read_messages
from valve_twin.io.salvage.read import forget
from valve_twin.io.tables.csv_export import convert_topics

CHUNK, INDEX, STATISTICS, CHUNK_INDEX = 6, 7, 11, 8
KINDS = ["zstd-crc-2000", "zstd-nocrc-2000", "lz4-crc-2000", "none-nocrc-2000"]


def records(data, begin=8, end=None):
    """Return opcode, begin and end of every record of a file."""
    found, at = [], begin
    while at < (len(data) - 8 if end is None else end):
        op, length = struct.unpack_from("<BQ", data, at)
        found.append((op, at, at + 9 + length))
        at += 9 + length
    return found


def sealed(data):
    """Return a file whose summary carries the check sum of what now stands in it."""
    data = bytearray(data)
    (start,) = struct.unpack_from("<Q", data, len(data) - 28)
    if struct.unpack_from("<I", data, len(data) - 12)[0]:
        struct.pack_into("<I", data, len(data) - 12, zlib.crc32(data[start : len(data) - 12]))
    return bytes(data)


def groups(data):
    """Return begin of the chunk, of its indexes and their end, of each chunk."""
    found = []
    for op, begin, end in records(data):
        if op == CHUNK:
            found.append([begin, end, end])
        elif op == INDEX:
            found[-1][2] = end
    return found


def swap_indexes(data, rng):
    """Exchange the message indexes of two chunks that are of one size."""
    all_of = groups(data)
    sizes: dict[int, list[tuple[int, int]]] = {}
    for _, at, end in all_of:
        sizes.setdefault(end - at, []).append((at, end))
    pairs = next(v for v in sizes.values() if len(v) > 1)
    (a, b), (c, d) = (pairs[i] for i in rng.choice(len(pairs), 2, replace=False))
    out = bytearray(data)
    out[a:b], out[c:d] = data[c:d], data[a:b]
    return bytes(out)


def wrong_places(data, rng):
    """Shift the places that one message index names."""
    at = [b for op, b, e in records(data) if op == INDEX and e - b > 15]
    begin = int(rng.choice(at))
    out = bytearray(data)
    (place,) = struct.unpack_from("<Q", out, begin + 23)
    struct.pack_into("<Q", out, begin + 23, place + 1)
    return bytes(out)


def wrong_middle(data, rng, *, swapped=False):
    """Change one entry in the middle of a message index, or exchange two in log time or place."""
    begins = [b for op, b, e in records(data) if op == INDEX and e - b > 15 + 4 * 16]
    begin = int(rng.choice(begins))
    (size,) = struct.unpack_from("<I", data, begin + 11)
    place = int(rng.integers(1, size // 16 - 2))
    at = begin + 15 + 16 * place + 8 * int(rng.integers(2))
    out = bytearray(data)
    if swapped:
        out[at : at + 8], out[at + 16 : at + 24] = data[at + 16 : at + 24], data[at : at + 8]
    else:
        out[at] ^= 1 << int(rng.integers(8))
    return bytes(out)


def swapped_middle(data, rng):
    """Exchange log times or places of two neighbours in the middle of a message index."""
    return wrong_middle(data, rng, swapped=True)


def wrong_counts(data, rng):
    """Count fewer messages of one topic in the statistics, so that the sum is still right."""
    out = bytearray(data)
    begin = next(b for op, b, _ in records(data) if op == STATISTICS)
    (first,) = struct.unpack_from("<Q", out, begin + 9 + 46 + 2)
    (total,) = struct.unpack_from("<Q", out, begin + 9)
    less = int(rng.integers(1, first))
    struct.pack_into("<Q", out, begin + 9 + 46 + 2, first - less)
    struct.pack_into("<Q", out, begin + 9, total - less)
    return sealed(out)


def wrong_times(data, rng, late_ns=3_000_000):
    """State a chunk index and the head of its chunk late, one to eight times `late_ns` [ns]."""
    out = bytearray(data)
    places = [b for op, b, _ in records(data) if op == CHUNK_INDEX]
    begin = int(rng.choice(places[1:-1]))
    start, end, offset = struct.unpack_from("<QQQ", out, begin + 9)
    late = late_ns * int(rng.integers(1, 9))
    struct.pack_into("<QQ", out, begin + 9, start + late, end + late)
    struct.pack_into("<QQ", out, offset + 9, start + late, end + late)
    return sealed(out)


def wrong_offset(data, rng):
    """Let a chunk index name the place of another chunk."""
    out = bytearray(data)
    places = [b for op, b, _ in records(data) if op == CHUNK_INDEX]
    one, other = (int(p) for p in rng.choice(places, 2, replace=False))
    out[one + 25 : one + 33] = data[other + 25 : other + 33]
    return sealed(out)


def swapped_chunks(data, rng):
    """Exchange two chunks with their indexes; the summary goes on naming the old places."""
    all_of = groups(data)
    n = int(rng.integers(len(all_of) - 1))
    (begin, _, middle), (_, _, end) = all_of[n : n + 2]
    return data[:begin] + data[middle:end] + data[begin:middle] + data[end:]


def repeated_entry(data, rng):
    """Name a chunk twice in the summary."""
    begin, end = next((b, e) for op, b, e in records(data) if op == CHUNK_INDEX)
    out = bytearray(data[:end] + data[begin:end] + data[end:])
    _, offsets = struct.unpack_from("<QQ", out, len(out) - 28)
    if offsets:
        struct.pack_into("<Q", out, len(out) - 20, offsets + end - begin)
    return sealed(out)


def repeated_chunk(data, rng):
    """Write a chunk with its indexes a second time into a file without summary."""
    begin, _, end = groups(data)[2]
    stop = next(b for op, b, _ in records(data) if op == 15)
    body = data[:end] + data[begin:end] + data[end : stop + 13]
    return body + struct.pack("<BQQQI", 2, 20, 0, 0, 0) + data[-8:]


LIES = [
    swap_indexes,
    wrong_places,
    wrong_middle,
    swapped_middle,
    wrong_counts,
    wrong_times,
    wrong_offset,
    swapped_chunks,
    repeated_entry,
    repeated_chunk,
]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("lie", LIES, ids=lambda f: f.__name__)
def test_a_lie_about_intact_chunks_loses_nothing_and_is_told(lie, kind, tmp_path, caplog):
    rng = np.random.default_rng(zlib.crc32(f"{kind}{lie.__name__}".encode()))
    truth = written(kind, rng, tmp_path, 300)
    path = tmp_path / "lying.mcap"
    sound = tmp_path / "sound.mcap"
    sound.write_bytes(truth.data)
    path.write_bytes(lie(truth.data, rng))
    forget()
    report = bag_report(path, verify=True)
    assert report["damaged"], report
    assert report["messages"] == truth.messages.total()
    assert not bag_report(sound, verify=True)["damaged"]

    sources = [SignalSource(n.split("/")[-1], n) for n, t in list(TOPICS.items())[:2]]
    caplog.clear()
    for a, b in zip(read_columns(path, sources), read_columns(sound, sources), strict=True):
        assert a.stamp_ns.tobytes() == b.stamp_ns.tobytes()
        assert a.values.tobytes() == b.values.tobytes()
    assert str(path) in caplog.text

    forget()
    caplog.clear()
    found = cut(path, tmp_path / "cut")
    assert str(path) in caplog.text
    assert sum(found.topics.values()) == truth.messages.total()
    kept = [(m.topic, m.log_ns, m.data) for m in read_messages(found.out, list(TOPICS))]
    assert kept == [(m.topic, m.log_ns, m.data) for m in read_messages(sound, list(TOPICS))]

    forget()
    rows = {w.topic: w.rows for w in convert_topics(path, tmp_path / "t.csv")}
    assert sum(rows.values()) == truth.messages.total()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("lie", LIES, ids=lambda f: f.__name__)
def test_who_meets_the_lie_while_he_reads_loses_nothing(lie, kind, tmp_path, caplog):
    rng = np.random.default_rng(zlib.crc32(f"first {kind}{lie.__name__}".encode()))
    truth = written(kind, rng, tmp_path, 300)
    path, sound = tmp_path / "lying.mcap", tmp_path / "sound.mcap"
    sound.write_bytes(truth.data)
    path.write_bytes(lie(truth.data, rng))
    sources = [SignalSource(n.split("/")[-1], n) for n in list(TOPICS)[:2]]
    forget()
    found = read_columns(path, sources)
    assert str(path) in caplog.text
    for a, b in zip(found, read_columns(sound, sources), strict=True):
        assert a.log_ns.tobytes() == b.log_ns.tobytes()
        assert a.values.tobytes() == b.values.tobytes()
    right = [(m.topic, m.log_ns, m.data) for m in read_messages(sound, list(TOPICS))]
    forget()
    cut(path, tmp_path / "cut")
    kept = read_messages(tmp_path / "cut", list(TOPICS))
    assert [(m.topic, m.log_ns, m.data) for m in kept] == right


@pytest.mark.parametrize("lie", [wrong_middle, swapped_middle], ids=lambda f: f.__name__)
def test_the_compiled_walk_tells_of_one_wrong_entry_wherever_it_stands(lie, tmp_path, caplog):
    import_module("valve_twin.io.cdr.columns_kernel")  # without it few messages are decoded
    rng = np.random.default_rng(5)
    truth = written("zstd-crc-2000", rng, tmp_path, 300)
    path, sound = tmp_path / "lying.mcap", tmp_path / "sound.mcap"
    sound.write_bytes(truth.data)
    sources = [SignalSource(n.split("/")[-1], n) for n in list(TOPICS)[:1]]
    (right,) = read_columns(sound, sources)
    assert caplog.text == ""
    for _ in range(40):
        path.write_bytes(lie(truth.data, rng))
        forget()
        caplog.clear()
        (found,) = read_columns(path, sources)
        assert "message index" in caplog.text
        assert found.log_ns.tobytes() == right.log_ns.tobytes()
        assert found.values.tobytes() == right.values.tobytes()


@pytest.mark.parametrize("summary", [True, False])
@pytest.mark.parametrize("what", ["length", "opcode"])
def test_a_file_without_chunks_that_breaks_in_the_middle_says_so(what, summary, tmp_path):
    rng = np.random.default_rng(7)
    data = written("loose-nocrc-0", rng, tmp_path, 30).data
    if not summary:
        stop = next(b for op, b, _ in records(data) if op == 15)
        data = data[: stop + 13] + struct.pack("<BQQQI", 2, 20, 0, 0, 0) + data[-8:]
    out = bytearray(data)
    seventh = [b for op, b, _ in records(data) if op == 5][7]
    if what == "length":
        struct.pack_into("<Q", out, seventh + 1, 2**40)
    else:
        out[seventh] = 0x45
    path = tmp_path / "broken.mcap"
    path.write_bytes(out)
    forget()
    for verify in (False, True):
        report = bag_report(path, verify=verify)
        assert report["damaged"]
        assert report["lost_messages"] in {1, None}
        assert any(str(seventh) in str(line["line"]) for line in report["damage"])
    names = {m.topic for m in read_messages(path, list(TOPICS))}
    assert names == set(TOPICS)


def apart(kind, folder, count=120):
    """Return a sound bag of a kind, taken apart."""
    return lies.taken_apart(written(kind, np.random.default_rng(3), folder, count).data)


def turned(bag):
    """Let the summary exchange the topics of two channels."""
    whole = [r for c in bag.chunks for r in c.defined] + [
        i for i in bag.items if isinstance(i, lies.Record)
    ]
    bag.defined = [
        lies.remapped(r, {1: 2, 2: 1}) for r in whole if r.op in {lies.SCHEMA, lies.CHANNEL}
    ]


def other_type(bag):
    """Let the summary define a type by a text of the same size."""
    turned(bag)
    assert bag.defined is not None
    bag.defined = [
        lies.Record(r.op, r.body.replace(b"float64 value", b"uint64  value"))
        for r in (lies.remapped(one, {1: 2, 2: 1}) for one in bag.defined)
    ]


@pytest.mark.parametrize("kind", ["zstd-crc-2000", "none-crc-2000"])
@pytest.mark.parametrize("lie", [turned, other_type], ids=lambda f: f.__name__)
def test_topics_are_those_that_the_data_define(lie, kind, tmp_path, caplog):
    bag = apart(kind, tmp_path)
    sound, path = tmp_path / "sound.mcap", tmp_path / "lying.mcap"
    sound.write_bytes(lies.written(bag).data)
    lie(bag)
    path.write_bytes(lies.written(bag).data)
    sources = [SignalSource(n.split("/")[-1], n) for n in list(TOPICS)[:2]]
    assert caplog.text == ""
    for a, b in zip(read_columns(path, sources), read_columns(sound, sources), strict=True):
        assert a.values.tobytes() == b.values.tobytes()
    assert str(path) in caplog.text
    assert bag_report(path, verify=True)["damaged"]


def test_a_topic_that_is_defined_anew_behind_messages_is_told(tmp_path, caplog):
    import_module("valve_twin.io.cdr.columns_kernel")
    bag = apart("zstd-crc-2000", tmp_path)
    topics = {r.body[:2]: r for c in bag.chunks for r in c.defined if r.op == lies.CHANNEL}
    chunk, path = bag.chunks[2], tmp_path / "lying.mcap"
    data = lies.written(bag).data
    path.write_bytes(data)
    (sound,) = read_columns(path, [SignalSource("position", "/press/position")])
    assert caplog.text == ""
    first, other = topics[b"\1\0"], topics[b"\2\0"]
    chunk.late = lies.Record(lies.CHANNEL, first.body[:2] + other.body[2:])
    path.write_bytes(lies.written(bag).data)
    forget()
    (found,) = read_columns(path, [SignalSource("position", "/press/position")])
    assert str(path) in caplog.text
    assert len(found) <= len(sound)
    assert bag_report(path, verify=True)["damaged"]


def test_topics_that_every_chunk_defines_again_behind_messages_cost_no_second_look(
    tmp_path, monkeypatch
):
    """Our own writer does so: each chunk was walked twice, the second time by Python."""
    import_module("valve_twin.io.cdr.columns_kernel")
    bag = apart("zstd-crc-2000", tmp_path)
    topic = next(r for c in bag.chunks for r in c.defined if r.op == lies.CHANNEL)
    for chunk in bag.chunks:
        chunk.late = topic
    path = tmp_path / "again.mcap"
    path.write_bytes(lies.written(bag).data)

    def look(*_):
        pytest.fail("a second look")

    monkeypatch.setattr(reader, "find_flaw", look)
    (found,) = read_columns(path, [SignalSource("position", "/press/position")])
    assert len(found) == 120
    assert len(bag.chunks) > 2


@pytest.mark.parametrize(
    "layout",
    [
        lies.Layout(indexes=False, counts=False),
        lies.Layout(indexes=False, summary=False),
        lies.Layout(indexes=False, known=False),
    ],
    ids=["summary", "no summary", "no chunk index"],
)
def test_messages_of_a_channel_that_nothing_defines_are_told(tmp_path, caplog, layout):
    bag = apart("zstd-crc-2000", tmp_path)
    bag.layout = layout
    chunk = bag.chunks[1]
    chunk.messages = [lies.renumbered(m, {1: 77}) for m in chunk.messages]
    path = tmp_path / "lying.mcap"
    path.write_bytes(lies.written(bag).data)
    cut(path, tmp_path / "cut")
    assert "77" in caplog.text
    assert bag_report(path, verify=True)["lost_messages"]


def test_a_bag_without_chunks_and_summary_is_cut_from_begin_to_end(tmp_path):
    bag = apart("loose-crc-0", tmp_path)
    bag.layout = lies.Layout(summary=False)
    path = tmp_path / "loose.mcap"
    path.write_bytes(lies.written(bag).data)
    held = bag.held()
    info = bag_info(path)
    assert info.message_count == len(held)
    assert (info.start_ns, info.end_ns) == (held[0].log_ns, max(m.log_ns for m in held))
    assert main(["cut", str(path), "--out", str(tmp_path / "cut")]) == 0
    assert bag_info(tmp_path / "cut").message_count == len(held)


def test_topics_that_no_summary_repeats_are_read_from_the_data(tmp_path, caplog):
    bag = apart("zstd-crc-2000", tmp_path)
    bag.layout = lies.Layout(repeats=False, indexes=False)
    path = tmp_path / "sparse.mcap"
    path.write_bytes(lies.written(bag).data)
    (found,) = read_columns(path, [SignalSource("position", "/press/position")])
    assert len(found) == 120
    assert caplog.text == ""


def test_statistics_that_count_no_topic_say_nothing_of_them(tmp_path, caplog):
    """An empty map means that it is not known."""
    bag = apart("zstd-crc-2000", tmp_path)
    bag.counts = replace(lies.written(bag).counts, by_channel={})
    path = tmp_path / "whole.mcap"
    path.write_bytes(lies.written(bag).data)
    (found,) = read_columns(path, [SignalSource("position", "/press/position")])
    assert len(found) == 120
    assert caplog.text == ""


def stray_counts(bag):
    """Put statistics among the data, of a file without a summary."""
    bag.layout = lies.Layout(summary=False)
    row = replace(lies.written(bag).counts, total=3).record()
    bag.items.insert(3, lies.Record(row[0], row[9:]))


def turned_offsets(bag):
    bag.offset_turn = 1


def wrong_sum(bag):
    bag.data_sum = 5


def first_summary(bag):
    bag.before = lies.written(bag).summary


def wrong_attachment(bag):
    bag.items.insert(1, lies.attachment("a", b"abc", 7, 5))


@pytest.mark.parametrize(
    "lie",
    [stray_counts, turned_offsets, wrong_sum, first_summary, wrong_attachment],
    ids=lambda f: f.__name__,
)
def test_what_others_would_believe_is_told_though_nothing_is_lost(lie, tmp_path):
    bag = apart("zstd-crc-2000", tmp_path)
    bag.layout = lies.Layout(data_sum=True)
    path = tmp_path / "lying.mcap"
    path.write_bytes(lies.written(bag).data)
    assert not bag_report(path, verify=True)["damaged"]
    lie(bag)
    path.write_bytes(lies.written(bag).data)
    report = bag_report(path, verify=True)
    assert report["damaged"]
    assert report["lost_messages"] == 0
    assert report["messages"] == len(bag.held())
    (found,) = read_columns(path, [SignalSource("position", "/press/position")])
    assert len(found) == 120
