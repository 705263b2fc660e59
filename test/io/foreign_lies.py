# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the verbs do with bags that lie consistently: nothing is lost in silence.

The data section is the truth. What indexes, summary or metadata say otherwise can be known:
`info --verify` ends with 1 and names the file, and each verb that reads gives what the truth
gives, or names the file. A bag that says nothing false is no error, whatever was taken out of it.
"""

from __future__ import annotations

import shutil
import time
from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import yaml

from test.bag_samples import write_sample
from test.io.foreign import LONGEST_S, START_NS
from test.io.foreign_verbs import said
from test.io.lies import (
    ATTACHMENT,
    CHANNEL,
    MESSAGE,
    SCHEMA,
    Bag,
    Chunk,
    Known,
    Layout,
    Record,
    attachment,
    moved,
    remapped,
    renumbered,
    spoken,
    taken_apart,
    written,
)
from test.peak import forget_peak, peak_mb
from valve_twin.io.bags.read import BagWriter
from valve_twin.io.cdr.signals import STAMPED_TYPE
from valve_twin.io.playback.player import read_messages

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from pathlib import Path

    from test.io.lies import Said

MOST_MB = 1000.0
_PERIOD_NS = 20_000_000
_COUNT = 100
_VALVE = """/**:
  ros__parameters:
    model: first_order
    period_s: 0.02
    signals:
      command: {topic: command}
      position: {topic: position}
    cycles: {rule: window, window_s: 0.6}
    options: {estimators: [output_error]}
"""
_TOPICS = ("/valve/command", "/valve/position")


@dataclass(slots=True)
class Case:
    """One bag that may lie.

    Attributes
    ----------
    bag : Bag
        The file.
    how : str
        What was done to it.
    odd : bool
        Whether its data section itself holds what no writer writes.
    harmless : bool
        Whether the false statement can lose nothing, so that nobody has to tell it.
    free : bool
        Whether a definition is another one, so that nobody can say what the messages mean.
    """

    bag: Bag
    how: str
    odd: bool = False
    harmless: bool = False
    free: bool = False


# -- what is changed in the data section


def _some(chunk: Chunk, rng: np.random.Generator) -> list[int]:
    """Return places of a few messages of a chunk."""
    count = min(len(chunk.messages), int(rng.integers(1, 6)))
    return sorted(rng.choice(len(chunk.messages), count, replace=False).tolist())


def _pick(bag: Bag, rng: np.random.Generator) -> Chunk:
    return bag.chunks[int(rng.integers(len(bag.chunks)))]


def left_out(case: Case, rng: np.random.Generator) -> None:
    """Leave chunks out; definitions that stand in them only go with them."""
    for _ in range(int(rng.integers(1, 3))):
        if len(case.bag.chunks) > 2:
            gone = case.bag.chunks[int(rng.integers(1, len(case.bag.chunks)))]
            case.bag.items.remove(gone)


def repeated(case: Case, rng: np.random.Generator) -> None:
    items = case.bag.items
    places = [n for n, i in enumerate(items) if isinstance(i, Chunk)]
    at, to = int(rng.choice(places)), int(rng.choice(places))
    items.insert(to + int(rng.integers(2)), Bag([items[at]]).copy().items[0])


def exchanged(case: Case, rng: np.random.Generator) -> None:
    items = case.bag.items
    places = [n for n, i in enumerate(items) if isinstance(i, Chunk)]
    a, b = (int(n) for n in rng.choice(places, 2, replace=False))
    items[a], items[b] = items[b], items[a]
    one, other = items[a], items[b]
    assert isinstance(one, Chunk)
    assert isinstance(other, Chunk)
    one.defined, other.defined = other.defined, one.defined


def carried(case: Case, rng: np.random.Generator) -> None:
    """Move messages from one chunk to another; index and times follow or not."""
    one, other = _pick(case.bag, rng), _pick(case.bag, rng)
    if one is other:
        return
    _remember(one, rng)
    _remember(other, rng)
    for at in reversed(_some(one, rng)):
        other.messages.append(one.messages.pop(at))
    if rng.random() < 0.5:
        other.messages.sort(key=lambda m: m.log_ns)


def _remember(chunk: Chunk, rng: np.random.Generator) -> None:
    """Let what is stated of a chunk stay as it is now, whatever becomes of it."""
    if rng.random() < 0.4:
        chunk.indexed = list(chunk.messages)
    if rng.random() < 0.4:
        chunk.span = chunk.times


def times_changed(case: Case, rng: np.random.Generator) -> None:
    chunk = _pick(case.bag, rng)
    _remember(chunk, rng)
    what = str(rng.choice(["log", "publish", "both", "far", "exchanged"]))
    late = int(rng.integers(-30, 30)) * _PERIOD_NS + 7_001
    late = late if what != "far" else int(rng.choice([-1, 1])) * 1_000_000_007_003
    places = _some(chunk, rng)
    if what == "exchanged" and len(places) > 1:
        a, b = places[:2]
        one, other = chunk.messages[a], chunk.messages[b]
        if one.channel == other.channel:
            chunk.messages[a] = one._replace(log_ns=other.log_ns)
            chunk.messages[b] = other._replace(log_ns=one.log_ns)
        return
    for n, at in enumerate(places):
        m = chunk.messages[at]
        log_ns = m.log_ns + (late + n if what != "publish" else 0)
        publish_ns = m.publish_ns + (late + n if what in {"publish", "both"} else 0)
        chunk.messages[at] = m._replace(log_ns=log_ns, publish_ns=publish_ns)


def channels_remapped(case: Case, rng: np.random.Generator) -> None:
    bag = case.bag
    what = str(rng.choice(["all", "summary", "one chunk", "unknown", "messages"]))
    numbers = {1: 2, 2: 1} if rng.random() < 0.5 else {1: 40, 2: 41}
    if what == "all":
        for chunk in bag.chunks:
            chunk.messages = [renumbered(m, numbers) for m in chunk.messages]
            chunk.defined = [remapped(r, numbers) for r in chunk.defined]
        bag.items = [remapped(i, numbers) if isinstance(i, Record) else i for i in bag.items]
        bag.items = [
            Record(MESSAGE, bytes(numbers.get(i.body[0], i.body[0]).to_bytes(2, "little"))
                   + i.body[2:]) if isinstance(i, Record) and i.op == MESSAGE else i
            for i in bag.items
        ]  # fmt: skip
        case.free |= 40 in _defined_numbers(bag) and 1 in _used(bag)
    elif what == "summary":
        bag.defined = [remapped(r, numbers) for r in _definitions(bag)]
    else:
        chunk = _pick(bag, rng)
        _remember(chunk, rng)
        to = {1: 77} if what == "unknown" else {1: 2} if what == "messages" else {1: 2, 2: 1}
        places = set(_some(chunk, rng)) if what != "one chunk" else set(range(10**4))
        chunk.messages = [
            renumbered(m, to) if n in places else m for n, m in enumerate(chunk.messages)
        ]


def _definitions(bag: Bag) -> list[Record]:
    """Return all definitions of a data section, each number once."""
    found: dict[tuple[int, bytes], Record] = {}
    for item in bag.items:
        for one in item.defined if isinstance(item, Chunk) else [item]:
            if one.op in {SCHEMA, CHANNEL}:
                found.setdefault((one.op, one.body[:2]), one)
    return list(found.values())


def _defined_numbers(bag: Bag) -> set[int]:
    return {int.from_bytes(r.body[:2], "little") for r in _definitions(bag) if r.op == CHANNEL}


def _used(bag: Bag) -> set[int]:
    return {m.channel for m in bag.held()}


def schema_exchanged(case: Case, rng: np.random.Generator) -> None:
    """Exchange a definition for another one of the same size: in the data, the summary, both."""
    pairs = ((b"float64 value", b"uint64  value"), (b"float64 value", b"float64 walue"))
    old, new = pairs[int(rng.integers(2))]

    def other(one: Record) -> Record:
        return Record(one.op, one.body.replace(old, new)) if one.op == SCHEMA else one

    what = str(rng.choice(["data", "summary", "both"]))
    bag = case.bag
    if what != "data":
        bag.defined = [other(r) for r in _definitions(bag)]
    else:
        bag.defined = _definitions(bag)
    if what != "summary":
        for chunk in bag.chunks:
            chunk.defined = [other(r) for r in chunk.defined]
        bag.items = [other(i) if isinstance(i, Record) else i for i in bag.items]
    case.free |= what != "summary"


def two_channels(case: Case, rng: np.random.Generator) -> None:
    """Let a part of a topic's messages come on a second channel of it."""
    bag = case.bag
    first = next(r for r in _definitions(bag) if r.op == CHANNEL)
    own = int.from_bytes(first.body[:2], "little")
    if 9 in _defined_numbers(bag):
        return
    bag.items.insert(0, remapped(first, {own: 9}))
    schema = next(r for r in _definitions(bag) if r.op == SCHEMA)
    bag.items.insert(0, schema)
    share = rng.random()
    for chunk in bag.chunks:
        chunk.messages = [
            renumbered(m, {own: 9}) if rng.random() < share else m for m in chunk.messages
        ]


def attached(case: Case, rng: np.random.Generator) -> None:
    """Put an attachment between the chunks; its bytes may look like chunks, its sum be wrong."""
    bag = case.bag
    what = str(rng.choice(["plain", "records", "wrong sum", "wrong size"]))
    data = bytes(rng.integers(0, 256, 300, dtype=np.uint8))
    if what == "records":
        data = written(Bag([*bag.copy().chunks[:2]], bag.layout)).data[8:-8]
    one = attachment("a.bin", data, START_NS, 5 if what == "wrong sum" else None)
    if what == "wrong size":
        at = one.body.index(data) - 8
        body = one.body[:at] + (len(data) + 5000).to_bytes(8, "little") + one.body[at + 8 :]
        one = Record(ATTACHMENT, body)
    bag.items.insert(int(rng.integers(len(bag.items) + 1)), one)
    case.odd |= what in {"wrong sum", "wrong size"}
    case.harmless |= what in {"wrong sum", "wrong size"}


def summary_in_data(case: Case, rng: np.random.Generator) -> None:
    """Put records of a summary among the data."""
    bag = case.bag
    made = written(bag.honest())
    less = replace(made.counts, total=made.counts.total - 1)
    rows = [less.record()] if rng.random() < 0.5 or not made.known else [made.known[-1].record()]
    for row in rows:
        at = int(rng.integers(len(bag.items) + 1))
        bag.items.insert(at, Record(row[0], row[9:]))
    case.odd = True


# -- what is stated about it


def spans_lie(case: Case, rng: np.random.Generator) -> None:
    for chunk in case.bag.chunks:
        if rng.random() < 0.5:
            continue
        start, end = chunk.times
        late = int(rng.integers(1, 9)) * _PERIOD_NS
        kinds = [(start + late, end + late), (start - late, end - late), (start + late, end),
                 (start, max(start, end - late)), (start - late, end + late), (0, 0),
                 (end, start)]  # fmt: skip
        chunk.span = kinds[int(rng.integers(len(kinds)))]


def counts_lie(case: Case, rng: np.random.Generator) -> None:
    true = written(case.bag.honest()).counts
    counted = dict(true.by_channel)
    what = str(rng.choice(["some", "one less", "moved", "total", "times", "chunks", "more"]))
    if not counted:
        return
    first = min(counted)
    if what == "some" and len(counted) > 1:
        del counted[first]
        if rng.random() < 0.5:
            true = replace(true, total=sum(counted.values()))
    elif what == "one less":
        counted[first] -= 1
        true = replace(true, total=true.total - 1)
    elif what == "more":
        counted[first] += 3
        true = replace(true, total=true.total + 3)
    elif what == "moved":
        counted[first] -= 1
        counted[max(counted)] += 1
    elif what == "total":
        true = replace(true, total=true.total + int(rng.integers(-5, 6)))
    elif what == "times":
        true = replace(true, start_ns=true.start_ns + int(rng.integers(-1, 2)) * _PERIOD_NS)
    else:
        true = replace(true, chunks=max(0, true.chunks + int(rng.integers(-1, 2))))
    case.bag.counts = replace(true, by_channel=counted)


def known_lies(case: Case, rng: np.random.Generator) -> None:
    known = written(case.bag.honest()).known
    if len(known) < 2:
        return
    a, b = (int(n) for n in rng.choice(len(known), 2, replace=False))
    what = str(rng.choice(["less", "twice", "place", "exchanged", "channels", "size"]))
    if what == "less":
        del known[a]
    elif what == "twice":
        known.insert(b, known[a])
    elif what == "place":
        known[a] = moved(known[a], known[b].at)
    elif what == "exchanged":
        one = moved(known[a], known[b].at)
        known[a], known[b] = one, moved(known[b], known[a].at)
    elif what == "channels":
        known[a].indexes = dict(list(known[a].indexes.items())[:1])
    else:
        known[a].size += 1
    case.bag.known = known


def offsets_turned(case: Case, rng: np.random.Generator) -> None:
    case.bag.offset_turn = int(rng.integers(1, 4))


def begin_elsewhere(case: Case, rng: np.random.Generator) -> None:
    """Let the footer name another record of the summary as its begin."""
    case.bag.start_shift = int(rng.integers(1, 6))


def two_summaries(case: Case, rng: np.random.Generator) -> None:
    case.bag.before = written(case.bag.honest()).summary


def data_sum_lies(case: Case, rng: np.random.Generator) -> None:
    case.bag.data_sum = int(rng.integers(1, 2**32))


DATA: dict[str, Callable[[Case, np.random.Generator], None]] = {
    f.__name__: f
    for f in (
        left_out,
        repeated,
        exchanged,
        carried,
        times_changed,
        channels_remapped,
        schema_exchanged,
        two_channels,
        attached,
        summary_in_data,
    )
}
STATED: dict[str, Callable[[Case, np.random.Generator], None]] = {
    f.__name__: f
    for f in (
        spans_lie,
        counts_lie,
        known_lies,
        offsets_turned,
        begin_elsewhere,
        two_summaries,
        data_sum_lies,
    )
}
"""Classes of lies."""


# -- one case


def _base(rng: np.random.Generator, folder: Path) -> Bag:
    """Return a sound bag of some kind."""
    bag = taken_apart((folder / "sound.mcap").read_bytes())
    packed = str(rng.choice(["zstd", "lz4", ""]))
    for chunk in bag.chunks:
        chunk.packed = packed
    flags = rng.random(8) < 0.8
    bag.layout = Layout(*(bool(f) for f in flags))
    bag.layout.data_sum = bool(rng.random() < 0.3)
    if rng.random() < 0.15:
        bag.items = [
            r
            for i in bag.items
            for r in (
                [*i.defined, *(Record(MESSAGE, spoken(m)) for m in i.messages)]
                if isinstance(i, Chunk)
                else [i]
            )
        ]
    return bag


def _stale(known: Sequence[Known], bag: Bag, rng: np.random.Generator) -> list[Known]:
    """Return what was known of the chunks before, at the places where they stand now or not."""
    now = written(bag.honest()).known
    if rng.random() < 0.5:
        return [moved(k, n.at) for k, n in zip(known, now, strict=False)]
    return list(known)


def case_of(folder: Path, rng: np.random.Generator) -> Case:
    """Return a bag that was changed in one or two ways."""
    bag = _base(rng, folder)
    before = written(bag)
    case = Case(bag, "")
    chunked = bool(bag.chunks)
    names = []
    classes = list(DATA) if rng.random() < 0.7 else list(STATED)
    if not chunked:
        classes = ["attached", "summary_in_data", "counts_lie", "offsets_turned", "data_sum_lies",
                   "begin_elsewhere", "two_summaries"]  # fmt: skip
    for _ in range(int(rng.integers(1, 3))):
        name = str(rng.choice(classes))
        names.append(name)
        (DATA | STATED)[name](case, rng)
    if names[0] in DATA:
        if rng.random() < 0.3 and chunked:
            bag.known = _stale(before.known, bag, rng)
            names.append("old index")
        if rng.random() < 0.3:
            bag.counts = before.counts
            names.append("old counts")
    case.how = f"{', '.join(names)}; {bag.layout}"
    return case


# -- what the verbs say


def of_files(folder: Path, seed: int, count: int, first: int = 0) -> list[str]:
    """Give lying files to the verbs; return a line for each that told too little."""
    desk = Desk(folder)
    for n in range(first, first + count):
        desk.judge(case_of(folder, np.random.default_rng([seed, n])), f"seed {seed} case {n}")
    return desk.closed()


def of_folders(folder: Path, seed: int, count: int, first: int = 0) -> list[str]:
    """Give bags of two files, whose metadata agree or lie; return a line for each wrong answer."""
    desk = Desk(folder)
    for n in range(first, first + count):
        desk.judge_folder(np.random.default_rng([seed, n]), f"seed {seed} case {n}")
    return desk.closed()


_NAMES = {
    "true": ("a_0.mcap", "a_1.mcap"),
    "old counts": ("a_0.mcap", "a_1.mcap"),
    "lying counts": ("a_0.mcap", "a_1.mcap"),
    "exchanged": ("a_1.mcap", "a_0.mcap"),
    "twice": ("a_0.mcap", "a_1.mcap", "a_0.mcap"),
    "one": ("a_0.mcap",),
    "gone": ("a_0.mcap", "a_1.mcap", "a_2.mcap"),
    "two folders": ("x/a.mcap", "y/a.mcap"),
    "two folders, twice": ("x/a.mcap", "y/a.mcap", "x/a.mcap"),
    "old names": ("bag/a_0.mcap", "/elsewhere/bag/a_1.mcap"),
    "outside": ("../bag/a_0.mcap", "a_1.mcap"),
}
"""Kinds of metadata, and the files that they name."""


def _metadata(names: Sequence[str], files: dict[str, Bag], counts: dict[str, int]) -> str:
    """Return the text of a metadata.yaml.

    Parameters
    ----------
    names : sequence of str
        The files that it names.
    files : dict
        By name.
    counts : dict
        Messages by topic [1].
    """
    spans = {n: [m.log_ns for m in bag.held()] for n, bag in files.items()}
    rows = []
    for name in dict.fromkeys(names):
        logs = spans.get(name) or next(iter(spans.values()))
        rows.append({
            "path": name, "message_count": len(logs),
            "starting_time": {"nanoseconds_since_epoch": min(logs)},
            "duration": {"nanoseconds": max(logs) - min(logs)},
        })  # fmt: skip
    topics = [
        {
            "topic_metadata": {"name": n, "type": STAMPED_TYPE, "serialization_format": "cdr"},
            "message_count": count,
        }
        for n, count in counts.items()
    ]
    about = {
        "version": 9, "storage_identifier": "mcap", "message_count": sum(counts.values()),
        "relative_file_paths": list(names), "files": rows, "topics_with_message_count": topics,
        "duration": {"nanoseconds": 0}, "starting_time": {"nanoseconds_since_epoch": START_NS},
        "compression_format": "", "compression_mode": "",
    }  # fmt: skip
    return yaml.safe_dump({"rosbag2_bagfile_information": about}, sort_keys=False)


def _topics_of(bag: Bag) -> dict[int, str]:
    return {
        int.from_bytes(r.body[:2], "little"): r.body[8 : 8 + r.body[4]].decode()
        for r in _definitions(bag)
        if r.op == CHANNEL
    }


def _counted(bags: Iterable[Bag]) -> dict[str, int]:
    found: Counter[str] = Counter()
    for bag in bags:
        topics = _topics_of(bag)
        found.update(topics[m.channel] for m in bag.held())
    return dict(found)


class Desk:
    """Runs the verbs and compares with what the truth gives.

    Parameters
    ----------
    folder : path
        Empty; the sound bag is made in it.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.config = folder, folder / "valve.yaml"
        self.config.write_text(_VALVE, encoding="utf-8")
        self.wrong: list[str] = []
        self.known: dict[bytes, dict[str, object]] = {}
        self.kinds: Counter[str] = Counter()
        rng, position = np.random.default_rng(5), 0.0
        with BagWriter(folder / "made", chunk_size=5_500) as writer:
            for i in range(_COUNT):
                command = (0.2, 0.8, 0.5, 0.1)[i // 15 % 4]
                position += 0.02 / 0.1 * (command - position)
                stamp = START_NS + i * _PERIOD_NS
                write_sample(writer, "/valve/command", stamp, command)
                noisy = position + 1e-3 * rng.standard_normal()
                write_sample(writer, "/valve/position", stamp, noisy, log_ns=stamp + 1000)
        shutil.move(folder / "made" / "made_0.mcap", folder / "sound.mcap")
        shutil.rmtree(folder / "made")
        forget_peak()
        self.before_mb = peak_mb()

    def judge(self, case: Case, name: str) -> None:
        """Give one file to the verbs."""
        path = self.folder / "a.mcap"
        made, honest = written(case.bag).data, written(case.bag.honest()).data
        path.write_bytes(made)
        known = _used(case.bag) <= _defined_numbers(case.bag)
        lies = made != honest or case.odd or case.bag.repeats() or not known
        truth = self.truth([case.bag]) if known and not case.free else None
        self.hold(path, name, case.how, lies=lies, truth=truth, case=case)
        path.unlink()

    def judge_folder(self, rng: np.random.Generator, name: str) -> None:
        """Give one bag of two files to the verbs."""
        whole = _base(rng, self.folder)
        whole.items = [i for i in whole.items if isinstance(i, Chunk)] or whole.items
        middle = len(whole.items) // 2
        parts = [Bag(whole.items[:middle], whole.layout), Bag(whole.items[middle:], whole.layout)]
        if not whole.chunks:  # the definitions stand at its begin only
            parts[1].items = [*_definitions(whole), *parts[1].items]
        before = _counted(parts)
        cases = [Case(part, "") for part in parts]
        how = [str(rng.choice(list(_NAMES)))]
        if whole.chunks and rng.random() < 0.6:
            which = str(rng.choice(["left_out", "exchanged", "counts_lie", "known_lies"]))
            how.append(which)
            (DATA | STATED)[which](cases[int(rng.integers(2))], rng)
        kind, path = how[0], self.folder / "bag"
        counts = _counted(parts)
        if kind == "old counts":
            counts = before
        elif kind == "lying counts" and parts[0].counts is not None:
            stated = parts[0].counts.by_channel
            counts = _counted(parts[1:])
            for channel, topic in _topics_of(parts[0]).items():
                counts[topic] = counts.get(topic, 0) + stated.get(channel, 0)
        elif kind == "lying counts":
            counts = {topic: count - 1 for topic, count in counts.items()}
        own = _NAMES[kind][:2] if "folders" in kind else ("a_0.mcap", "a_1.mcap")
        for file, part in zip(own, parts, strict=True):
            (path / file).parent.mkdir(parents=True, exist_ok=True)
            (path / file).write_bytes(written(part).data)
        text = _metadata(_NAMES[kind], dict(zip(own, parts, strict=True)), counts)
        (path / "metadata.yaml").write_text(text, encoding="utf-8")
        lies = any(written(p).data != written(p.honest()).data for p in parts)
        lies |= counts != _counted(parts) or kind in {"twice", "one", "gone", "two folders, twice"}
        truth = self.truth(parts)
        self.hold(path, name, f"{', '.join(how)}; {whole.layout}", lies=lies, truth=truth)
        shutil.rmtree(path)

    def truth(self, bags: Sequence[Bag]) -> dict[str, object]:
        """Return what the verbs give for a sound file of the same messages."""
        held: list[tuple[str, Said]] = []
        for bag in bags:
            topics = _topics_of(bag)
            held += [(topics[m.channel], m) for m in bag.held()]
        held.sort(key=lambda one: (one[1].log_ns, one[0]))
        key = repr([(t, m.log_ns, m.publish_ns, m.data) for t, m in held]).encode()
        if key not in self.known:
            sound = taken_apart((self.folder / "sound.mcap").read_bytes())
            defined = _definitions(sound)
            numbers = {name: i for i, name in _topics_of(sound).items()}
            messages = [m._replace(channel=numbers[t]) for t, m in held]
            path = self.folder / "b.mcap"
            path.write_bytes(written(Bag([Chunk(defined, messages)])).data)
            if len(self.known) > 200:
                self.known.clear()
            self.known[key] = {v: found for v, (_, found, _) in self.given(path).items()}
            path.unlink()
        return self.known[key]

    def given(self, path: Path) -> dict[str, tuple[int, object, str]]:
        """Run the verbs that read; return exit code, content and words of each."""
        found = {}
        out = self.folder / "out"
        for verb in ("convert", "cut", "estimate", "predict"):
            target = out.with_suffix({"estimate": ".json", "cut": ""}.get(verb, ".csv"))
            more: tuple[str | Path, ...]
            more = ("--json" if verb == "estimate" else "--out", target)
            if verb != "cut":
                more = ("--config", self.config, *more)
            code, text = said(verb, path, *more)
            found[verb] = code, _content(target), text
            shutil.rmtree(target, ignore_errors=True)
            target.unlink(missing_ok=True)
        return found

    def hold(
        self,
        path: Path,
        name: str,
        how: str,
        *,
        lies: bool,
        truth: dict[str, object] | None,
        case: Case | None = None,
    ) -> None:
        """Compare what the verbs say of a bag with what can be known of it.

        Parameters
        ----------
        path : path
            The bag.
        name, how : str
            Which case it is.
        lies : bool
            Whether something that it states is false.
        truth : dict, optional
            What each verb has to give; None = nobody can say.
        case : Case, optional
            The file, where it is one.
        """
        begin = time.process_time()
        code, text = said("info", path, "--verify")
        say = f"{name} ({how})"
        harmless = case is not None and (case.harmless or _is_wide(case))
        free = case is not None and case.free
        if code not in {0, 1} or (code == 1 and str(path) not in text) or _broke(text):
            self.wrong.append(f"{say}: info --verify {code}: {text}")
        elif bool(code) != lies and not (free or (harmless and lies)):
            self.wrong.append(f"{say}: info --verify {code} though {lies=}: {text[-600:]}")
        before = set(self.folder.iterdir())
        for verb, (done, found, words) in self.given(path).items():
            right = truth is not None and found == truth[verb]
            told = str(path) in words
            if done not in ((0, 1, 2) if lies or free else (0, 1)) or _broke(words):
                self.wrong.append(f"{say}: {verb} {done}: {words[-600:]}")
            elif not right and not told and not free:
                self.wrong.append(f"{say}: {verb} {done} differs untold: {words[-600:]}")
            elif not lies and not right and not free:
                self.wrong.append(f"{say}: {verb} {done} differs: {words[-600:]}")
        if set(self.folder.iterdir()) != before:
            self.wrong.append(f"{say}: files were left")
        if time.process_time() - begin > LONGEST_S:
            self.wrong.append(f"{say}: {time.process_time() - begin:.0f} s")
        self.kinds["lies" if lies else "true"] += 1

    def closed(self) -> list[str]:
        """Return what was wrong."""
        grown = peak_mb() - self.before_mb
        return self.wrong + ([f"{grown:.0f} MB"] if grown > MOST_MB else [])


def _is_wide(case: Case) -> bool:
    """Return whether just wider times of chunks, or counts of what is not read, are false."""
    bag = case.bag.copy()
    if bag.counts is not None:
        true = written(bag.honest()).counts
        bag.counts = replace(
            bag.counts, attachments=true.attachments, schemas=true.schemas, channels=true.channels
        )
    for chunk in bag.chunks:
        start, end = chunk.times
        if chunk.span is not None and chunk.span[0] <= start and end <= chunk.span[1]:
            chunk.span = None
    return written(bag).data == written(bag.honest()).data and not (case.odd or bag.repeats())


def _broke(text: str) -> bool:
    return "Traceback" in text or "something unexpected" in text


def _content(out: Path) -> object:
    if out.is_file():
        return out.read_bytes()
    if not out.is_dir():
        return None
    return [(m.topic, m.log_ns, m.publish_ns, m.data) for m in read_messages(out, _TOPICS)]
