# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Turn measured CSV files into a bag through the signal mapping of a valve.

The bag holds the numbers as they stand in the file; scale and offset are applied where the bag is
read, with the same configuration. Several files follow one another on one clock, each announced on
the topic `run` by its name.
"""

from __future__ import annotations

import shutil
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import datetime, timezone
from glob import glob
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.cycle.plausibility import LARGEST, unit_fault, wrong_step
from valve_twin.core.types import CycleRule, FloatArray, IntArray
from valve_twin.core.valves.registry import get_model
from valve_twin.io.bags.qos import QosProfile
from valve_twin.io.bags.writer import BagWriter
from valve_twin.io.cdr.codec import encode_series, encode_stamped, encode_string
from valve_twin.io.cdr.signals import SERIES_TYPE, STAMPED_TYPE, SignalSource
from valve_twin.io.config.topic_names import resolve_topic
from valve_twin.io.errors import BagError, ConfigError
from valve_twin.io.tables.csv import Table, read_table

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from valve_twin.io.config.valve import ValveConfig

RUN_TOPIC = "run"
"""Topic below the valve's name with the name of the file whose rows follow."""

STRING_TYPE = "std_msgs/msg/String"

SECOND_NS = 1_000_000_000
LATCHED = QosProfile(durability="transient_local", depth=1)
RAW_DEPTH = QosProfile(depth=1000)
_IRREGULAR = 0.01
"""A row whose step is off the sampling time by more than this part begins a new batch [1]."""


@dataclass(frozen=True, slots=True)
class ImportedFile:
    """One file as it lies in the bag: name without endings, stamps of first and last row [ns]."""

    name: str
    start_ns: int
    end_ns: int
    rows: int


@dataclass(frozen=True, slots=True)
class ImportSummary:
    """What an import wrote.

    Attributes
    ----------
    files : tuple of ImportedFile
        In their order.
    messages : int
        Written into the bag.
    notices : tuple of str
        What looks wrong in a file but could be so, one line each: columns that never change or
        are not in the unit that the valve's model expects.
    """

    files: tuple[ImportedFile, ...]
    messages: int
    notices: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Return it in words."""
        rows = sum(f.rows for f in self.files)
        return f"{len(self.files)} files, {rows} rows, {self.messages} messages"


@dataclass(frozen=True, slots=True)
class Stream:
    """One topic to write: its column, and the samples in a message (0 = single ones)."""

    topic: str
    column: str
    batch: int


@dataclass(frozen=True, slots=True)
class Readings:
    """One file as a reader gives it: the stamps [ns] and values of each topic."""

    name: str
    columns: list[tuple[Stream, IntArray, FloatArray]]
    notices: tuple[str, ...] = ()


def csv_files(pattern: str | Path) -> list[Path]:
    """Return the CSV files that a path, a folder or a pattern with * names, in natural order.

    Raises
    ------
    BagError
        If there are none.
    """
    path = Path(pattern)
    if path.is_file():
        return [path]
    if path.is_dir():
        found = [p for p in path.iterdir() if p.name.endswith((".csv", ".csv.gz"))]
    else:
        found = [Path(name) for name in glob(str(pattern)) if Path(name).is_file()]
    if not found:
        msg = (
            f"{pattern}: there is no such CSV file; give a file, a folder or a pattern such "
            "as 'runs/*.csv.gz'"
        )
        raise BagError(msg)
    return sorted(found)


def import_csv(
    files: Sequence[str | Path],
    config: ValveConfig,
    out: str | Path,
    *,
    on_file: Callable[[], object] = lambda: None,
) -> ImportSummary:
    """Write CSV files into a new bag folder.

    Parameters
    ----------
    files : sequence of path
        Files, folders or patterns, in the order in which they follow one another.
    config : ValveConfig
        Its signals name their columns; its `csv` section says how the time is read.
    out : path
        Bag folder to make.
    on_file : callable
        Called after every file.

    Returns
    -------
    ImportSummary
        What lies in the bag.

    Raises
    ------
    BagError
        If a file cannot be read or its time does not rise; names the file, the line and the value.
    ConfigError
        If no signal names a column, or the mapping cannot be written.
    """
    paths = [path for pattern in files for path in csv_files(pattern)]
    streams = streams_of(config)
    base_ns = base_stamp_ns(config)

    def read(path: Path, end_ns: int | None) -> Readings:
        table = _read(path, config, streams)
        stamps = _stamps(table, config, base_ns, end_ns)
        columns = table.columns[len(table.columns) - len(streams) :]
        return Readings(
            path.name.removesuffix(".gz").removesuffix(".csv"),
            [(s, stamps, values) for s, values in zip(streams, columns, strict=True)],
            (*table.notices, *_notices(table, config)),
        )

    return import_files(paths, config, out, read, topics=streams, on_file=on_file)


def import_files(
    paths: Sequence[Path],
    config: ValveConfig,
    out: str | Path,
    read: Callable[[Path, int | None], Readings],
    *,
    topics: Sequence[Stream] = (),
    leave_out: bool = False,
    notices: Sequence[str] = (),
    on_file: Callable[[], object],
) -> ImportSummary:
    """Write files into a new bag folder, parameters as `import_csv`; none where none can be read.

    `read` gives a file that follows a stamp [ns], None for the first, or raises BagError: with
    `leave_out` it is left out as long as another can be read. `topics` are those of every file.
    """
    bag: BagWriter | None = None
    done: list[ImportedFile] = []
    told = list(notices)
    try:
        for path in paths:
            try:
                file = read(path, done[-1].end_ns if done else None)
            except BagError as err:
                if not leave_out or (path == paths[-1] and not done):
                    raise
                told.append(f"left out: {err}")
                continue
            if bag is None:  # a wrong column or time leaves no bag behind
                bag = BagWriter(out, flush_s=60.0)
                _add_topics(bag, topics)
                bag.add_topic(resolve_topic(RUN_TOPIC, config.name), STRING_TYPE, qos=(LATCHED,))
            told += file.notices
            done.append(_write_file(bag, config, file))
            on_file()
    except BagError as err:
        if bag is None or leave_out or not done:
            raise
        msg = f"{err}; {bag.path} holds only the {len(done)} files before it: remove it"
        raise BagError(msg) from err
    else:
        assert bag is not None  # the last file would have raised
        bag.note({"valve": config.name, "model": config.model, "imported_files": len(done)})
        return ImportSummary(tuple(done), sum(bag.counts.values()), tuple(told))
    finally:
        if bag is not None:
            with ExitStack() as stack:
                if not done:  # a part of the first file is no bag of it
                    stack.callback(shutil.rmtree, bag.path, ignore_errors=True)
                bag.close()


def streams_of(config: ValveConfig) -> list[Stream]:
    """Return the topics to write, one a column that signals take."""
    streams: dict[str, Stream] = {}
    for source in config.signals.values():
        if not source.column:
            continue
        stream = Stream(source.topic, source.column, _batch(source, config))
        known = streams.setdefault(source.topic, stream)
        if known != stream:
            msg = (
                f"valve {config.name}: topic '{source.topic}' takes column "
                f"'{known.column}' and '{source.column}'; "
                f"give signals.{source.signal}.topic a name of its own"
            )
            raise ConfigError(msg)
    if not streams:
        names = ", ".join(f"signals.{name}.column" for name in config.signals)
        msg = f"valve {config.name}: no signal names its column of the CSV file; write {names}"
        raise ConfigError(msg)
    return list(streams.values())


def _batch(source: SignalSource, config: ValveConfig) -> int:
    fields = {STAMPED_TYPE: ("value", 0), SERIES_TYPE: ("values[]", config.csv.batch)}
    name, batch = fields.get(source.type, ("", 0))
    if source.field != name:
        msg = (
            f"valve {config.name}: signal '{source.signal}' is mapped to {source.field} "
            f"of {source.type}, which an "
            f"import does not write; write signals.{source.signal}.type: {STAMPED_TYPE} "
            f"or {SERIES_TYPE}"
        )
        raise ConfigError(msg)
    return batch


def base_stamp_ns(config: ValveConfig) -> int | None:
    """Return the stamp of the first row, at the start of a window; None = as in the file."""
    text = config.csv.base_stamp
    if not text:
        return None
    try:
        when = datetime.fromisoformat(text.replace("Z", "+00:00"))
    except ValueError:
        msg = (
            f"valve {config.name}: key 'csv.base_stamp': value '{text}' is no date and time; "
            "write it as 2020-01-01T00:00:00Z"
        )
        raise ConfigError(msg) from None
    when = when if when.tzinfo else when.replace(tzinfo=timezone.utc)
    base_ns = round(when.timestamp() * 1e6) * 1000
    if config.cycles.rule is CycleRule.WINDOW:
        window_ns = round(config.cycles.window_s * 1e9)
        offset_ns = round(config.cycles.window_offset_s * 1e9)
        base_ns += -(base_ns - offset_ns) % window_ns
    return base_ns


def _read(path: Path, config: ValveConfig, streams: Sequence[Stream]) -> Table:
    time = [config.csv.time_column] if config.csv.time_column else []
    names = [*time, *(s.column for s in streams)]
    return read_table(path, names, separator=config.csv.separator, dates=bool(time))


def _stamps(
    table: Table, config: ValveConfig, base_ns: int | None, end_ns: int | None
) -> IntArray:
    """Return the (N,) stamps of the rows [ns]."""
    if not config.csv.time_column:
        ticks = np.arange(len(table.lines)) * config.period_s
    else:
        ticks = table.columns[0] * (1.0 if table.dated else config.csv.time_scale)
        _check_time(table, ticks, config)
    if config.csv.time_column:
        elapsed_ns: IntArray = np.rint((ticks - ticks[0]) * 1e9).astype(np.int64)
        _check_sampling(table, elapsed_ns, config)
    if table.dated or base_ns is None:
        stamps: IntArray = np.rint(ticks * 1e6).astype(np.int64) * 1000
        follows(table.path, int(stamps[0]), end_ns)
        return stamps
    begin_ns = base_ns if end_ns is None else end_ns + round(config.csv.gap_s * SECOND_NS)
    elapsed: IntArray = np.rint((ticks - ticks[0]) * 1e9).astype(np.int64)
    return begin_ns + elapsed


def follows(path: Path, start_ns: int, end_ns: int | None) -> None:
    """Refuse a file whose first stamp is not after the last one of the file before it [ns].

    Parameters
    ----------
    path : Path
        The file.
    start_ns, end_ns : int
        Both stamps [ns]; None = it is the first file.
    """
    if end_ns is not None and start_ns <= end_ns:
        when = "begins before the file before it ends"
        msg = f"{path}: {when}; give the files in the order of their time"
        raise BagError(msg)


def _check_time(table: Table, ticks: FloatArray, config: ValveConfig) -> None:
    name = config.csv.time_column
    lost = np.flatnonzero(~np.isfinite(ticks))
    if len(lost):
        msg = f"{table.path}:{table.lines[lost[0]]}: column '{name}' has no time; remove the row"
        raise BagError(msg)
    back = np.flatnonzero(np.diff(ticks) <= 0.0)
    if 1 < len(back) == len(ticks) - 1 and ticks[0] > ticks[-1]:
        msg = (
            f"{table.path}: the rows run backwards in time, column '{name}' from "
            f"{table.columns[0][0]:.12g} to {table.columns[0][-1]:.12g}; sort the file by it, "
            "the oldest row first"
        )
        raise BagError(msg)
    if len(back):
        at = int(back[0]) + 1
        raw = table.columns[0]
        what = "repeats the time" if raw[at] == raw[at - 1] else "goes back in time"
        msg = (
            f"{table.path}:{table.lines[at]}: column '{name}' {what}, {raw[at]:.12g} "
            f"after {raw[at - 1]:.12g}; "
            f"remove the row or sort the file ({len(back)} such rows)"
        )
        raise BagError(msg)


def _check_sampling(table: Table, stamps: IntArray, config: ValveConfig) -> None:
    """Refuse rows that are not period_s apart: estimates would be wrong by the same factor."""
    step_s = wrong_step(stamps, config.period_s)
    if step_s:
        scale = "" if table.dated else f" or csv.time_scale, now {config.csv.time_scale:g}"
        msg = (
            f"{table.path}: column '{config.csv.time_column}': the rows are {step_s:.4g} s apart, "
            f"period_s is {config.period_s:.4g}; correct period_s{scale}"
        )
        raise BagError(msg)


def _notices(table: Table, config: ValveConfig) -> list[str]:
    """Say what looks wrong in the columns but could be so."""
    columns = table.columns[len(table.columns) - len(streams_of(config)) :]
    by_topic = dict(zip((s.topic for s in streams_of(config)), columns, strict=True))
    model = get_model(config.model)
    normalised = (*model.inputs, model.output) if model.normalised else ()
    notices = []
    for source in config.signals.values():
        if not source.column or source.signal not in (*model.inputs, model.output):
            continue
        raw = by_topic[source.topic]
        values = raw[np.isfinite(raw)]
        where = f"{table.path}: column '{source.column}'"
        if not len(values):
            notices.append(f"{where} holds no number")
            continue
        if len(values) > 1 and float(np.ptp(values)) == 0.0:
            notices.append(f"{where} is {values[0]:.6g} in all {len(values)} rows")
        if source.signal in normalised:
            mapped = source.scale * values + source.offset
            fault = unit_fault(source.signal, mapped, LARGEST - 2.0, LARGEST)
            notices += [f"{where}: {fault}"] if fault else []
    return notices


def _add_topics(bag: BagWriter, streams: Iterable[Stream]) -> None:
    for stream in streams:
        kind = SERIES_TYPE if stream.batch else STAMPED_TYPE
        bag.add_topic(stream.topic, kind, qos=(RAW_DEPTH,))


def _write_file(bag: BagWriter, config: ValveConfig, file: Readings) -> ImportedFile:
    _add_topics(bag, (stream for stream, _, _ in file.columns))
    lengths = [len(stamps) for _, stamps, _ in file.columns]
    start_ns = min(int(stamps[0]) for _, stamps, _ in file.columns)
    end_ns = max(int(stamps[-1]) for _, stamps, _ in file.columns)
    bag.write(resolve_topic(RUN_TOPIC, config.name), encode_string(file.name), log_ns=start_ns)
    if not any(stream.batch for stream, _, _ in file.columns):
        bag.write_samples([(s.topic, stamps, values) for s, stamps, values in file.columns])
    else:
        messages = [
            (log_ns, number, stream.topic, data, stamp_ns)
            for number, (stream, stamps, values) in enumerate(file.columns)
            for log_ns, stamp_ns, data in encode_stream(stream, stamps, values, config.period_s)
        ]
        for log_ns, _, topic, data, stamp_ns in sorted(messages, key=lambda m: m[:2]):
            bag.write(topic, data, log_ns=log_ns, publish_ns=stamp_ns)
    return ImportedFile(file.name, start_ns, end_ns, max(lengths))


def encode_stream(
    stream: Stream, stamps: IntArray, values: FloatArray, period_s: float
) -> Iterator[tuple[int, int, bytes]]:
    """Yield log time, stamp and bytes of the messages; a batch is logged with its last sample.

    Parameters
    ----------
    stream : Stream
        Single messages or batches.
    stamps : (N,) int64 array
        Of the rows [ns].
    values : (N,) array
        Numbers as they stand in the file [unit of the column].
    period_s : float
        Sampling time [s].
    """
    if not stream.batch:
        for stamp, value in zip(stamps.tolist(), values.tolist(), strict=True):
            yield stamp, stamp, encode_stamped(stamp, value)
        return
    period_ns = period_s * 1e9
    breaks = np.flatnonzero(np.abs(np.diff(stamps) - period_ns) > _IRREGULAR * period_ns) + 1
    edges = [0, *breaks.tolist(), len(stamps)]
    for begin, end in pairwise(edges):
        for at in range(begin, end, stream.batch):
            part = slice(at, min(at + stream.batch, end))
            first, last = int(stamps[part][0]), int(stamps[part][-1])
            count = len(stamps[part])
            step_s = (last - first) / (count - 1) * 1e-9 if count > 1 else period_s
            yield last, first, encode_series(first, step_s, values[part])
