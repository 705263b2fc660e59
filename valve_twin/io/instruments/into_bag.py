# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Write the files of instruments into a bag: every channel a topic, mapped or not."""

from __future__ import annotations

from glob import glob
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.cycle.plausibility import wrong_step
from valve_twin.core.quantity import suggest
from valve_twin.core.valves.registry import get_model
from valve_twin.io.config.topic_names import resolve_topic
from valve_twin.io.errors import BagError, ConfigError
from valve_twin.io.instruments.clock import ClockChoice
from valve_twin.io.instruments.derived import with_derived
from valve_twin.io.instruments.read import SUFFIXES, kind_of, read_recording
from valve_twin.io.instruments.table import topic_name, unique_name
from valve_twin.io.tables.csv_import import (
    SECOND_NS,
    ImportSummary,
    Readings,
    Stream,
    base_stamp_ns,
    follows,
    import_files,
    streams_of,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.io.instruments.table import Recording

CHANNELS = "channels"
"""Below the valve's name: the topics of channels that no signal takes."""


def recording_files(patterns: Sequence[str | Path]) -> list[Path]:
    """Return the files that paths, folders and patterns with * name, each folder's in order.

    Raises
    ------
    BagError
        If one names none.
    """
    found: list[Path] = []
    for pattern in patterns:
        path = Path(pattern)
        if path.is_dir() and kind_of(path) == "mcap":
            here = sorted(p for p in path.iterdir() if _is_one(p))
        elif path.exists():
            here = [path]
        else:
            here = sorted(Path(name) for name in glob(str(pattern)))
        if not here:
            msg = f"{pattern}: there is no such file; give a file, a folder or 'runs/*.csv'"
            raise BagError(msg)
        found += here
    return found


def _is_one(path: Path) -> bool:
    return path.is_file() and path.name.lower().removesuffix(".gz").endswith(tuple(SUFFIXES))


def needs_reader(files: Sequence[str | Path], config: ValveConfig) -> bool:
    """Return whether files are imported channel by channel rather than as plain CSV."""
    if config.csv.reader == "any":
        return True
    first = Path(files[0])
    return first.is_file() and kind_of(first) != "text"


def import_recordings(
    files: Sequence[str | Path],
    config: ValveConfig,
    out: str | Path,
    *,
    on_file: Callable[[], object] = lambda: None,
) -> ImportSummary:
    """Write files of instruments into a new bag folder.

    Parameters
    ----------
    files : sequence of path
        Files, folders or patterns in the order in which they follow one another. One that cannot
        be read, or lacks a channel that a signal takes, is named in the notices and left out.
    config : ValveConfig
        Its signals name their channels by `column`; its `csv` section says what is known of the
        time.
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
        If no file can be used; says why the first cannot.
    ConfigError
        If no signal names a column, the mapping cannot be written, or an entry of
        `csv.leave_out` names two files, or all that are given are left out.
    """
    streams = streams_of(config)
    given = recording_files(files)
    named = _left_out(given, config.csv.leave_out)
    paths = [p for p in given if p not in named]
    notices = [f"left out: {p}: csv.leave_out names it" for p in given if p in named]

    def read(path: Path, end_ns: int | None) -> Readings:
        recording = _read(path, config, streams)
        start_ns = _start_ns(recording, config, end_ns)
        return _readings(recording, config, streams, start_ns)

    return import_files(paths, config, out, read, leave_out=True, notices=notices, on_file=on_file)


def _left_out(given: Sequence[Path], names: Sequence[str]) -> set[Path]:
    """Return the files whose paths end with one of the names; one of two, or all, are refused."""
    found: set[Path] = set()
    for name in names:
        parts = PurePath(name).parts
        ends = [p for p in given if parts and p.absolute().parts[-len(parts) :] == parts]
        if len({p.absolute() for p in ends}) > 1:
            msg = (
                f"csv.leave_out: '{name}' names {ends[0]} and {ends[1]}; "
                "write the folder before the name"
            )
            raise ConfigError(msg)
        found.update(ends)
    if found.issuperset(given):
        msg = (
            f"csv.leave_out names every file given ({given[0]}); "
            "give other files or take the entry out"
        )
        raise ConfigError(msg)
    return found


def _read(path: Path, config: ValveConfig, streams: Sequence[Stream]) -> Recording:
    csv = config.csv
    if csv.time_column:
        choice = ClockChoice(csv.time_column, csv.time_scale, resample_s=csv.resample_s)
    else:
        rows_s = csv.row_s or config.period_s
        choice = ClockChoice(period_s=rows_s, resample_s=csv.resample_s)
    recording = with_derived(read_recording(path, choice), (s.column for s in streams))
    names = [c.name for c in recording.columns]
    for stream in streams:
        if stream.column not in names:
            msg = f"{path}: there is no channel '{stream.column}'; {suggest(stream.column, names)}"
            raise BagError(msg)
    source = config.signals[get_model(config.model).output]
    position = recording.columns[names.index(source.column)] if source.column else None
    if position is None:
        return recording
    step_s = wrong_step(np.rint(position.seconds * 1e9).astype(np.int64), config.period_s)
    if step_s:
        msg = (
            f"{path}: channel '{position.name}': samples are {step_s:.4g} s apart, period_s is "
            f"{config.period_s:.4g}; correct period_s"
        )
        raise BagError(msg)
    return recording


def _start_ns(recording: Recording, config: ValveConfig, end_ns: int | None) -> int:
    """Return the stamp of a recording's time 0 [ns]."""
    base_ns = base_stamp_ns(config)
    if recording.start_ns is not None and base_ns is None:
        follows(recording.path, recording.start_ns, end_ns)
        return recording.start_ns
    return base_ns or 0 if end_ns is None else end_ns + round(config.csv.gap_s * SECOND_NS)


def _readings(
    recording: Recording, config: ValveConfig, streams: Sequence[Stream], start_ns: int
) -> Readings:
    """Return what to write: channels without a signal as those with one."""
    taken = {s.topic for s in streams}
    batch = max((s.batch for s in streams), default=0)
    all_streams = list(streams)
    for column in recording.columns:
        if all(s.column != column.name for s in streams):
            plain = resolve_topic(f"{CHANNELS}/{topic_name(column.name)}", config.name)
            topic = unique_name(plain, taken)
            taken.add(topic)
            all_streams.append(Stream(topic, column.name, batch))
    columns = {c.name: c for c in recording.columns}
    name = recording.path.name.removesuffix(".gz").rpartition(".")[0] or recording.path.name
    return Readings(
        name,
        [
            (s, start_ns + np.rint(c.seconds * 1e9).astype(np.int64), c.values)
            for s in all_streams
            for c in (columns[s.column],)
        ],
        recording.notices,
    )
