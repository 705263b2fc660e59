# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Files as they may come from outside: sound ones, seeded mutations, and what has to hold of them.

Each class of file has a `Subject`: the sound bytes, how they are read, and an oracle that says
whether what was read of mutated bytes may be said silently.
"""

from __future__ import annotations

import io
import logging
import sqlite3
import struct
import time
from contextlib import closing, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from mcap.records import Schema

from test.bag_samples import write_sample
from test.io.instruments import foreign_files
from test.io.instruments.unseen import may_be as unseen
from test.io.instruments.unseen import may_be_text, places_of, touched
from test.peak import forget_peak, peak_mb
from valve_twin.cli import main
from valve_twin.core.types import Estimate, EstimateStatus, ParameterStatus, ParameterValue
from valve_twin.io.bags.definitions import definition
from valve_twin.io.bags.read import BagWriter, read_columns
from valve_twin.io.bags.report import bag_report
from valve_twin.io.cdr.bag_types import BagTypes
from valve_twin.io.cdr.codec import encode_series, encode_stamped
from valve_twin.io.cdr.signals import SERIES_TYPE, STAMPED_TYPE, SignalSource
from valve_twin.io.config.valve import load_config
from valve_twin.io.errors import IndexLiesError, ValveTwinError
from valve_twin.io.history.store import CycleRecord, History
from valve_twin.io.instruments.clock import ClockChoice
from valve_twin.io.instruments.read import read_recording
from valve_twin.io.salvage.read import forget
from valve_twin.io.tables.csv import read_table

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from valve_twin.io.instruments.table import Recording

START_NS = 1_577_836_800_000_000_000
SOURCES = [SignalSource("position", "/press/position"), SignalSource("command", "/press/command")]
LONGEST_S = 10.0
NUMBERS = (0, 1, 2**31, 2**32 - 1, 2**63 - 1, 2**64 - 1)
TOKENS = [
    b"1:30", b"1_000", b"0x10", b"{}", b"[]", b"~", b"-", b"nan", b".inf", b"1e999", b'"', b"'",
    b"&a", b"*a", b"!!int", b"!!python/none", b"\x00", b"\xff\xfe", b"%", b"@", b"|", b">", b"- -",
    b"? ", b"[" * 40, b"9" * 30, b"-1", b"1,5", b"1.000,5", b"\t", b"\r", b"\n\n", b"=1+1",
    b"true", b"\xc3\x28",
]  # fmt: skip


class _Told(logging.Handler):
    """Remembers whether anything was said."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.count = 0

    def emit(self, record: logging.LogRecord) -> None:
        self.count += 1


@dataclass(slots=True)
class Subject:
    """One class of foreign files.

    Attributes
    ----------
    name : str
        File name in its folder.
    data : bytes
        The sound file.
    read : callable
        Reads the file at a path; returns what is compared.
    may_be : callable
        Whether a result of mutated bytes may be returned without a word: result, sound result and
        the mutated bytes.
    """

    name: str
    data: bytes
    read: Callable[[Path], object]
    may_be: Callable[[object, object, bytes], bool]


@dataclass(slots=True)
class Tally:
    """What a campaign met."""

    cases: int = 0
    refused: int = 0
    told: int = 0
    same: int = 0
    unseen: int = 0
    tracebacks: list[str] = field(default_factory=list)
    silent: list[str] = field(default_factory=list)
    slow: list[str] = field(default_factory=list)
    grown_mb: float = 0.0


def mutations(data: bytes, rng: np.random.Generator, count: int) -> Iterator[tuple[str, bytes]]:
    """Yield a name and mutated bytes."""
    kinds = ["flip", "flips", "cut", "token", "double", "drop", "swap", "number", "zeros"]
    for _ in range(count):
        kind = str(rng.choice(kinds))
        out = bytearray(data)
        at, other = sorted(int(n) for n in rng.integers(0, len(data), 2))
        span = min(other - at, 200)
        if kind == "flip":
            out[at] ^= int(rng.integers(1, 256))
        elif kind == "flips":
            for place in rng.integers(0, len(data), 8).tolist():
                out[place] ^= int(rng.integers(1, 256))
        elif kind == "cut":
            del out[at:]
        elif kind == "token":
            out[at : at + int(rng.integers(0, 6))] = TOKENS[int(rng.integers(len(TOKENS)))]
        elif kind == "double":
            out[at:at] = out[at : at + span]
        elif kind == "drop":
            del out[at : at + span]
        elif kind == "swap":
            out[at : at + 40], out[other : other + 40] = (
                data[other : other + 40],
                data[at : at + 40],
            )
        elif kind == "number":
            out[at : at + 8] = struct.pack("<Q", NUMBERS[int(rng.integers(len(NUMBERS)))])
        else:
            out[at : at + span] = bytes(span)
        yield kind, bytes(out)


def campaign(subject: Subject, folder: Path, seed: int, count: int) -> Tally:
    """Mutate a file many times and read each; return what was met."""
    rng = np.random.default_rng(seed)
    path = folder / subject.name
    path.write_bytes(subject.data)
    sound = subject.read(path)
    tally = Tally()
    ear = _Told()
    logger = logging.getLogger("valve_twin")
    logger.addHandler(ear)
    forget_peak()
    before_mb = peak_mb()
    try:
        for n, (kind, data) in enumerate(mutations(subject.data, rng, count)):
            path.write_bytes(data)
            forget()
            ear.count = 0
            case = f"{subject.name} seed {seed} case {n} ({kind})"
            begin = time.process_time()
            tally.cases += 1
            try:
                found = _read_twice(subject, path)
            except ValveTwinError:
                tally.refused += 1
            except Exception as err:
                tally.tracebacks.append(f"{case}: {type(err).__name__}: {err}")
            else:
                if ear.count:
                    tally.told += 1
                elif found == sound:
                    tally.same += 1
                elif subject.may_be(found, sound, data):
                    tally.unseen += 1
                else:
                    tally.silent.append(case)
            if time.process_time() - begin > LONGEST_S:
                tally.slow.append(case)
    finally:
        logger.removeHandler(ear)
    tally.grown_mb = peak_mb() - before_mb
    return tally


def _read_twice(subject: Subject, path: Path) -> object:
    """Read as the verbs do: once more where a bag states wrong times."""
    try:
        return subject.read(path)
    except IndexLiesError:
        return subject.read(path)


def bag(folder: Path) -> Subject:
    """Return a bag of ours: every message stands under a check sum."""
    with BagWriter(folder / "made", chunk_size=1500) as writer:
        for i in range(60):
            write_sample(writer, "/press/position", START_NS + i * 10_000_000, 0.25 * i)
            write_sample(writer, "/press/command", START_NS + i * 10_000_000, -0.5 * i)

    def read(path: Path) -> object:
        columns = read_columns(path, SOURCES)
        return [(c.stamp_ns.tobytes(), c.values.tobytes()) for c in columns]

    return Subject(
        "a.mcap", (folder / "made" / "made_0.mcap").read_bytes(), read, lambda *_: False
    )


def metadata(folder: Path) -> Subject:
    """Return the metadata of a bag; what stands in the files must come whatever it says."""
    with BagWriter(folder / "meta") as writer:
        for i in range(5):
            write_sample(writer, "/press/position", START_NS + i * 10_000_000, 0.25 * i)

    def read(path: Path) -> object:
        report = bag_report(path.parent)
        (columns,) = read_columns(path.parent, SOURCES[:1])
        if report["damaged"]:
            logging.getLogger("valve_twin").warning("told")
        return columns.values.tobytes()

    data = (folder / "meta" / "metadata.yaml").read_bytes()
    return Subject("meta/metadata.yaml", data, read, lambda *_: False)


def configuration(_: Path) -> Subject:
    """Return a configuration; what is accepted has to be within the bounds of every key."""
    text = (
        "/**:\n  ros__parameters:\n    model: press_cartridge\n    period_s: 0.03\n"
        "    hold_back_s: 2.0\n    signals:\n      spool_position: {topic: position, lower: -1.0, "
        "upper: 1.0}\n    cycles:\n      rule: window\n      window_s: 300.0\n"
    )

    def read(path: Path) -> object:
        return [(c.name, c.period_s, c.hold_back_s, c.cycles) for c in load_config(path)]

    def may_be(found: object, _sound: object, _data: bytes) -> bool:
        assert isinstance(found, list)
        return all(1e-6 <= c[1] <= 3600.0 and 0.0 <= c[2] <= 3600.0 for c in found)

    return Subject("valve.yaml", text.encode(), read, may_be)


def table(_: Path) -> Subject:
    """Return a CSV file; the rows before the mutation stay what they are."""
    rows = [f"{0.01 * i:.2f},{0.5 * i},{-0.25 * i}" for i in range(60)]

    def read(path: Path) -> object:
        found = read_table(path, ["t", "x"])
        return [c.tolist() for c in found.columns]

    sound = "t,x,y\n" + "\n".join(rows) + "\n"

    def may_be(found: object, before: object, data: bytes) -> bool:
        same = 0
        for a, b in zip(data.splitlines(), sound.encode().splitlines(), strict=False):
            if a != b:
                break
            same += 1
        assert isinstance(found, list)
        assert isinstance(before, list)
        count = max(0, same - 1)
        lines = len([x for x in data.decode("utf-8", "replace").splitlines() if x.strip()])
        whole = all(len(c) >= lines - 1 for c in found)
        return whole and all(a[:count] == b[:count] for a, b in zip(found, before, strict=True))

    return Subject("a.csv", sound.encode(), read, may_be)


def messages(_: Path) -> Subject:
    """Return serialized messages behind one another, each with its length."""
    kinds = (STAMPED_TYPE, SERIES_TYPE)
    types = [BagTypes(Schema(1, definition(k).encode(), "ros2msg", k), "here") for k in kinds]
    parts = [encode_stamped(START_NS, 1.5, "frame"), encode_series(START_NS, 0.03, np.arange(7.0))]
    sizes = [len(p) for p in parts]

    def split(data: bytes) -> list[bytes]:
        return [data[: sizes[0]], data[sizes[0] : sum(sizes)]]

    def read(path: Path) -> object:
        pieces = split(path.read_bytes())
        return [_shown(kind.decode(d, 7)) for d, kind in zip(pieces, types, strict=True)]

    def may_be(found: object, _sound: object, data: bytes) -> bool:
        return found == [_numbers(d, many) for d, many in zip(split(data), (0, 1), strict=True)]

    return Subject("a.cdr", b"".join(parts), read, may_be)


def _shown(message: Any) -> tuple[object, ...]:
    """Return all that a message shows, numbers as their bits."""
    header = message.header
    numbers = [message.period, *message.values] if hasattr(message, "period") else [message.value]
    bits = struct.pack(f"<{len(numbers)}d", *numbers)
    return header.stamp.sec, header.stamp.nanosec, header.frame_id, bits


def _numbers(data: bytes, many: int) -> tuple[object, ...] | None:
    """Read a message place by place, by the rules of CDR alone; None where it does not fit."""
    order = "<" if data[1:2] == b"\x01" else ">"
    try:
        sec, nanosec, size = struct.unpack_from(f"{order}iII", data, 4)
        text = data[16 : 16 + size]
        at = 16 + size
        at += -(at - 4) % 8
        numbers = list(struct.unpack_from(f"{order}d", data, at))
        if many:
            (count,) = struct.unpack_from(f"{order}I", data, at + 8)
            numbers += struct.unpack_from(f"{order}{count}d", data, at + 16) if count else ()
        frame = text[:-1].decode() if len(text) == size else None
    except (struct.error, UnicodeDecodeError):
        return None
    bits = struct.pack(f"<{len(numbers)}d", *numbers)
    return None if frame is None else (sec, nanosec, frame, bits)


def history(folder: Path) -> Subject:
    """Return a history database; a row is shown as it was stored or not at all."""
    made = folder / "made.sqlite"
    with History(made) as store:
        for cycle in range(1, 9):
            values = (ParameterValue("K_in", 0.1 * cycle, ParameterStatus.OK),)
            found = Estimate(
                "press", "oe", cycle, 0, cycle, values, EstimateStatus.ACCEPTED, "good"
            )
            store.store("/v", CycleRecord(cycle, 0, cycle, 850), [found])
    with closing(sqlite3.connect(made)) as connection:
        connection.execute("PRAGMA journal_mode=DELETE")

    def read(path: Path) -> object:
        with History(path, read_only=True) as store:
            return [repr(row) for row in (*store.cycles("/v"), *store.estimates("/v"))]

    def may_be(shown: object, sound: object, _: bytes) -> bool:
        assert isinstance(shown, list)
        assert isinstance(sound, list)
        return set(shown) <= set(sound)

    data = made.read_bytes()
    for left in folder.glob("made.sqlite*"):
        left.unlink()
    return Subject("a.sqlite", data, read, may_be)


def recording(kind: str, suffix: str, folder: Path) -> Subject:
    """Return a file of an instrument: what was read of it without a word is what was written.

    Most have no check sums, so that a number or a name may be another one where just its bytes
    were changed, see `unseen`.
    """
    made = folder / "made"
    made.mkdir()
    place = made / f"a{suffix}"
    getattr(foreign_files, kind)(place)
    data = place.read_bytes()
    places = None if kind == "text" else places_of(kind, place)

    def read(path: Path) -> object:
        found = read_recording(path)
        if found.notices or not found.measured:
            logging.getLogger("valve_twin").warning("told")
        return Shown(found)

    def may_be(found: object, before: object, mutated: bytes) -> bool:
        assert isinstance(found, Shown)
        assert isinstance(before, Shown)
        if places is None:
            return may_be_text(found.recording, before.recording, mutated, data)
        if len(mutated) != len(data):
            return False
        return unseen(found.recording, before.recording, places, touched(data, mutated))

    return Subject(place.name, data, read, may_be)


def sqlite_bag(folder: Path) -> Subject:
    """Return a bag of storage sqlite3, whose rows stand under no check sum."""
    own = folder / "sqlite"
    foreign_files.sqlite_bag(own)
    place = next(own.glob("*.db3"))
    data, places = place.read_bytes(), places_of("sqlite", place)

    def read(path: Path) -> object:
        found = read_recording(path.parent)
        if found.notices or found.clock != "header stamps":
            logging.getLogger("valve_twin").warning("told")
        return Shown(found)

    def may_be(found: object, before: object, mutated: bytes) -> bool:
        assert isinstance(found, Shown)
        assert isinstance(before, Shown)
        same = len(mutated) == len(data)
        return same and unseen(found.recording, before.recording, places, touched(data, mutated))

    return Subject(f"sqlite/{place.name}", data, read, may_be)


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """A recording that is compared by all its bits."""

    recording: Recording

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Shown) and self._bits() == other._bits()

    def __hash__(self) -> int:
        return hash(str(self._bits()))

    def _bits(self) -> object:
        columns = self.recording.columns
        return self.recording.start_ns, [
            (c.name, c.unit, c.seconds.tobytes(), c.values.tobytes()) for c in columns
        ]


_VALVE = """/**:
  ros__parameters:
    model: first_order
    period_s: 0.05
    signals:
      command: {topic: command, column: %s}
      position: {topic: position, column: %s}
    cycles: {rule: window, window_s: 2.0}
    csv: {reader: any}
"""
_CHANNELS = {
    "text": ("Sollwert", "Druck"),
    "excel": ("Set point", "Pressure"),
    "mat5": ("log.setpoint", "log.p_bar"),
    "mat73": ("log.setpoint", "log.p"),
    "tdms": ("setpoint", "p"),
    "mdf": ("setpoint", "p"),
    "parquet": ("setpoint", "p_bar"),
}
"""Command and answer in the files of `foreign_files`."""


def imported(kind: str, folder: Path, seed: int, count: int) -> list[str]:
    """Import mutated files; return a line for each of which the verb told less than its reader.

    What cannot be read, or lacks a channel that is asked for, is refused; every notice of the
    reader is said; else the bag holds what was read.
    """
    subject = recording(kind, INSTRUMENTS[kind], folder)
    path, config = folder / subject.name, folder / "valve.yaml"
    config.write_text(_VALVE % _CHANNELS[kind], encoding="utf-8")
    sources = [SignalSource(name, f"/valve/{name}") for name in ("command", "position")]
    wrong = []
    rng = np.random.default_rng(seed)
    for n, (how, data) in enumerate(mutations(subject.data, rng, count)):
        path.write_bytes(data)
        bag, said = folder / f"bag_{n}", io.StringIO()
        with redirect_stderr(said), redirect_stdout(io.StringIO()):
            given = [str(path), "--config", str(config), "--out", str(bag)]
            done = main(["import", *given])
        try:
            found = read_recording(path, ClockChoice(period_s=0.05))
        except ValveTwinError:
            found = None
        columns = {} if found is None else {c.name: c for c in found.columns}
        if found is None or not set(_CHANNELS[kind]) <= set(columns):
            told = done != 0 and str(path) in said.getvalue()
        else:
            told = all(notice in said.getvalue() for notice in found.notices)
            if done == 0:
                stored = read_columns(bag, sources)
                asked = [columns[name] for name in _CHANNELS[kind]]
                told &= all(
                    np.array_equal(s.values, c.values, equal_nan=True)
                    or str(path) in said.getvalue()
                    for s, c in zip(stored, asked, strict=True)
                )
        if not told:
            wrong.append(f"{kind} seed {seed} case {n} ({how}): {said.getvalue()}")
    return wrong


INSTRUMENTS = {
    "text": ".csv",
    "excel": ".xlsx",
    "mat5": ".mat",
    "mat73": ".mat",
    "tdms": ".tdms",
    "mdf": ".mf4",
    "parquet": ".parquet",
}

SUBJECTS: dict[str, Callable[[Path], Subject]] = {
    **{kind: partial(recording, kind, suffix) for kind, suffix in INSTRUMENTS.items()},
    "sqlite": sqlite_bag,
    "history": history,
    "bag": bag,
    "metadata": metadata,
    "configuration": configuration,
    "table": table,
    "messages": messages,
}
