# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read bags: what is in them, and signals as columns in log-time order.

A bag is a rosbag2 folder, its metadata.yaml or one .mcap file. Messages are decoded with the
definitions in the bag, and what was read is counted against the summary of each file.
"""

from __future__ import annotations

import re
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.io.bag_types import BagTypes
from valve_twin.io.bag_writer import BagWriter
from valve_twin.io.columns import Columns, gather
from valve_twin.io.errors import BagError, suggest
from valve_twin.io.mapping import Extractor, SignalBlock, SignalSource, TypeSystem, full_type_name
from valve_twin.io.mcap_reader import McapFile, messages
from valve_twin.io.metadata import FILE_NAME, QosProfile, read_metadata

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from valve_twin.core.types import BoolArray, FloatArray, IntArray
    from valve_twin.io.mcap_format import Channel, ChunkIndex

__all__ = [
    "BagInfo",
    "BagWriter",
    "QosProfile",
    "TopicInfo",
    "bag_info",
    "bag_types",
    "read_signals",
    "read_texts",
]

SLICE_S = 1.0
"""Log time in one round of blocks [s]: below the default of hold_back_s, so that no signal waits
for another in vain."""


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """One topic of a bag; `count` is -1 where the bag does not say."""

    name: str
    type: str
    count: int
    qos: str = ""


@dataclass(frozen=True, slots=True)
class BagInfo:
    """What a bag holds.

    Attributes
    ----------
    path : Path
        As given.
    files : tuple of Path
        Its .mcap files in their order.
    start_ns, end_ns : int
        First and last log time [ns].
    message_count : int
        Messages according to the summaries, -1 = unknown.
    topics : tuple of TopicInfo
        By name.
    custom : dict
        Values of the user's own.
    size : int
        Bytes of all files [B].
    """

    path: Path
    files: tuple[Path, ...]
    start_ns: int
    end_ns: int
    message_count: int
    topics: tuple[TopicInfo, ...]
    custom: dict[str, str]
    size: int

    @property
    def duration_s(self) -> float:
        """Time from the first to the last message [s]."""
        return (self.end_ns - self.start_ns) * 1e-9


def bag_files(path: str | Path) -> tuple[tuple[Path, ...], dict[str, str]]:
    """Return the .mcap files of a bag in their order and the user's own values in its metadata.

    Raises
    ------
    BagError
        If there is no such bag.
    """
    path = Path(path)
    folder = path.parent if path.name == FILE_NAME else path
    if path.is_dir() or path.name == FILE_NAME:
        if (folder / FILE_NAME).is_file():
            metadata = read_metadata(folder / FILE_NAME)
            files = tuple(folder / Path(name).name for name in metadata.files)
            return files, dict(metadata.custom)
        files = tuple(sorted(folder.glob("*.mcap"), key=_natural))
        if not files:
            msg = f"{path}: holds no .mcap file; give a bag folder with MCAP storage"
            raise BagError(msg)
        return files, {}
    return (path,), {}


def _natural(path: Path) -> list[tuple[bool, int, str]]:
    """Sort key that puts bag_2 before bag_10."""
    parts = re.split(r"(\d+)", path.name)
    return [(p.isdigit(), int(p) if p.isdigit() else 0, p) for p in parts]


def topic_name(name: str) -> str:
    """Return a topic with its leading slash, which some old bags lack."""
    return name if name.startswith("/") else f"/{name}"


def bag_info(path: str | Path) -> BagInfo:
    """Return what a bag holds according to its summaries.

    Raises
    ------
    BagError
        If it cannot be read; one line with the file and what to do.
    """
    files, custom = bag_files(path)
    with ExitStack() as stack:
        opened = [_opened(f, stack) for f in files]
        for file in opened:
            custom = {**file.summary.metadata.get("valve_twin", {}), **custom}
        return _info(Path(path), opened, custom)


def _opened(path: Path, stack: ExitStack) -> McapFile:
    file = McapFile(path)
    stack.callback(file.close)
    return file


def _info(path: Path, opened: Sequence[McapFile], custom: dict[str, str]) -> BagInfo:
    topics: dict[str, TopicInfo] = {}
    starts, ends, total = [], [], 0
    for file in opened:
        summary, statistics = file.summary, file.summary.statistics
        total = -1 if statistics is None or total < 0 else total + statistics.message_count
        filled = [c for c in summary.chunks if c.end_ns or c.start_ns]
        starts += [c.start_ns for c in filled]
        ends += [c.end_ns for c in filled]
        if statistics is not None and statistics.message_count:
            starts.append(statistics.start_ns)
            ends.append(statistics.end_ns)
        for channel in summary.channels.values():
            _add_topic(topics, file, channel)
    return BagInfo(
        path=path,
        files=tuple(f.path for f in opened),
        start_ns=min(starts, default=0),
        end_ns=max(ends, default=0),
        message_count=total,
        topics=tuple(topics[name] for name in sorted(topics)),
        custom=custom,
        size=sum(f.path.stat().st_size for f in opened),
    )


def _add_topic(topics: dict[str, TopicInfo], file: McapFile, channel: Channel) -> None:
    name = topic_name(channel.topic)
    statistics = file.summary.statistics
    schema = file.summary.schemas.get(channel.schema_id)
    count = -1 if statistics is None else statistics.counts.get(channel.id, 0)
    before = topics.get(name)
    if before is not None:
        count = -1 if min(count, before.count) < 0 else count + before.count
    topics[name] = TopicInfo(
        name,
        _full(schema.name) if schema else "",
        count,
        channel.metadata.get("offered_qos_profiles", ""),
    )


def _full(name: str) -> str:
    try:
        return full_type_name(name)
    except ValueError:
        return name


def bag_types(path: str | Path, topic: str) -> TypeSystem:
    """Return the types of a topic as the bag defines them.

    Raises
    ------
    BagError
        If the bag cannot be read or has no such topic.
    """
    files, _ = bag_files(path)
    with ExitStack() as stack:
        for name in files:
            file = _opened(name, stack)
            for channel in file.summary.channels.values():
                if topic_name(channel.topic) == topic_name(topic):
                    return _types(file, channel)
    raise _missing(path, topic, "", [t.name for t in bag_info(path).topics])


def _types(file: McapFile, channel: Channel) -> BagTypes:
    place = f"{file.path}: topic '{channel.topic}'"
    schema = file.summary.schemas.get(channel.schema_id)
    if schema is None:
        msg = f"{place}: the file holds no definition of its type; record the topic anew"
        raise BagError(msg)
    if channel.encoding != "cdr":
        msg = (
            f"{place}: encoding '{channel.encoding}' is not read; record the topic with ROS 2 "
            "(cdr)"
        )
        raise BagError(msg)
    return BagTypes(schema, place)


@dataclass(slots=True)
class _Column:
    """A signal of one channel of one file, with what was read of it."""

    source: SignalSource
    extractor: Extractor
    types: BagTypes
    channel: int
    read: int = 0


@dataclass(slots=True)
class _Samples:
    """Samples of one signal that wait to be given out, in log-time order once sorted."""

    log_ns: list[IntArray] = field(default_factory=list)
    stamp_ns: list[IntArray] = field(default_factory=list)
    values: list[FloatArray] = field(default_factory=list)
    stamped: list[BoolArray] = field(default_factory=list)

    def add(self, part: Columns) -> None:
        self.log_ns.append(part.log_ns)
        self.stamp_ns.append(part.stamp_ns)
        self.values.append(part.values)
        self.stamped.append(part.stamped)

    def ordered(self) -> Columns:
        log_ns = np.concatenate(self.log_ns)
        parts = (
            log_ns,
            np.concatenate(self.stamp_ns),
            np.concatenate(self.values),
            np.concatenate(self.stamped),
        )
        if bool((log_ns[1:] >= log_ns[:-1]).all()):
            return Columns(*parts)
        order = np.argsort(log_ns, kind="stable")
        return Columns(*(p[order] for p in parts))  # type: ignore[arg-type]


def read_signals(
    path: str | Path, sources: Iterable[SignalSource], *, slice_s: float = SLICE_S
) -> Iterator[SignalBlock]:
    """Return the samples of some signals of a bag as blocks in log-time order.

    Parameters
    ----------
    path : path
        Bag folder, metadata.yaml or .mcap file.
    sources : iterable of SignalSource
        What is wanted; several may share a topic.
    slice_s : float
        Log time in one round of blocks [s]: each signal has at most one block a round, in the
        order of `sources`.

    Returns
    -------
    iterator of SignalBlock
        Everything about topics, types and fields is checked before it is returned.

    Raises
    ------
    BagError
        If the bag cannot be read, a topic is missing, empty or of another type, or fewer messages
        were read than the summary counts; one line with the file, the topic and what to do.
    ConfigError
        If a field does not fit its type.
    """
    wanted = list(sources)
    names, _ = bag_files(path)
    stack = ExitStack()
    try:
        files = [_opened(name, stack) for name in names]
        columns = {i: _columns_of(file, wanted) for i, file in enumerate(files)}
        _check_topics(path, files, wanted)
    except BaseException:
        stack.close()
        raise
    return _blocks(stack, files, columns, wanted, max(1, round(slice_s * 1e9)))


def _columns_of(file: McapFile, wanted: Sequence[SignalSource]) -> list[_Column]:
    columns = []
    for channel in file.summary.channels.values():
        sources = [s for s in wanted if topic_name(channel.topic) == s.topic]
        if not sources:
            continue
        types = _types(file, channel)
        for source in sources:
            if source.type != types.name:
                msg = (
                    f"{file.path}: topic '{source.topic}' is of type {types.name}, not "
                    f"{source.type}; "
                    f"write signals.{source.signal}.type: {types.name}"
                )
                raise BagError(msg)
            extractor = Extractor(source, types, str(file.path))
            columns.append(_Column(source, extractor, types, channel.id))
    return columns


def _check_topics(
    path: str | Path, files: Sequence[McapFile], wanted: Sequence[SignalSource]
) -> None:
    info = _info(Path(path), files, {})
    counts = {t.name: t.count for t in info.topics}
    for source in wanted:
        if source.topic not in counts:
            raise _missing(path, source.topic, f" of signal '{source.signal}'", list(counts))
        if counts[source.topic] == 0:
            msg = (
                f"{path}: topic '{source.topic}' of signal '{source.signal}' has no messages; "
                "check that its publisher ran, or map another topic"
            )
            raise BagError(msg)


def _missing(path: str | Path, topic: str, what: str, names: Sequence[str]) -> BagError:
    hint = suggest(topic, names)
    there = f" there are {', '.join(names)}" if hint.startswith("did you") else ""
    return BagError(f"{path}: topic '{topic}'{what} is not in the bag; {hint}{there}")


def _blocks(
    stack: ExitStack,
    files: Sequence[McapFile],
    columns: dict[int, list[_Column]],
    wanted: Sequence[SignalSource],
    slice_ns: int,
) -> Iterator[SignalBlock]:
    with stack:
        for group in _groups(files):
            samples = {i: _Samples() for i in range(len(wanted))}
            for number, chunk in group:
                _read_chunk(files[number], chunk, columns[number], wanted, samples)
            yield from _slices(samples, wanted, slice_ns)
        for number, file in enumerate(files):
            _check_counts(file, columns[number])


def _groups(files: Sequence[McapFile]) -> Iterator[list[tuple[int, ChunkIndex | None]]]:
    """Yield chunks of all files in order of time; those that overlap in time come together."""
    chunks: list[tuple[int, ChunkIndex | None]] = []
    for number, file in enumerate(files):
        if not file.summary.chunks:
            chunks.append((number, None))
    if chunks:
        chunks += [(n, c) for n, file in enumerate(files) for c in file.summary.chunks]
        yield chunks
        return
    ordered = sorted(
        (
            (c.start_ns, c.end_ns, n, c)
            for n, file in enumerate(files)
            for c in file.summary.chunks
        ),
        key=lambda item: item[:3],
    )
    group: list[tuple[int, ChunkIndex | None]] = []
    until = -1
    for start, end, number, chunk in ordered:
        if group and start > until:
            yield group
            group = []
        group.append((number, chunk))
        until = max(until, end)
    if group:
        yield group


def _read_chunk(
    file: McapFile,
    chunk: ChunkIndex | None,
    columns: Sequence[_Column],
    wanted: Sequence[SignalSource],
    samples: dict[int, _Samples],
) -> None:
    present = None if chunk is None or not chunk.message_indexes else set(chunk.message_indexes)
    needed = [c for c in columns if present is None or c.channel in present]
    if not needed:
        return
    data = file.loose_messages() if chunk is None else file.chunk(chunk)
    general = []
    for column in needed:
        offsets = file.offsets(chunk, column.channel) if chunk is not None else None
        part = None if offsets is None else gather(data, offsets, column.source, column.channel)
        if part is None:
            general.append(column)
            continue
        column.read += part.messages
        samples[wanted.index(column.source)].add(part)
    _decode(data, general, wanted, samples)


def _decode(
    data: bytes,
    columns: Sequence[_Column],
    wanted: Sequence[SignalSource],
    samples: dict[int, _Samples],
) -> None:
    """Decode message by message what cannot be gathered."""
    by_channel: dict[int, list[_Column]] = {}
    for column in columns:
        by_channel.setdefault(column.channel, []).append(column)
    if not by_channel:
        return
    for message in messages(data, set(by_channel)):
        group = by_channel[message.channel]
        decoded = group[0].types.decode(message.data, message.log_ns)
        for column in group:
            block = column.extractor(decoded, message.log_ns)
            column.read += 1
            count = len(block.values)
            part = Columns(
                np.full(count, message.log_ns, dtype=np.int64),
                block.stamp_ns,
                block.values,
                np.full(count, block.has_header),
                1,
            )
            samples[wanted.index(column.source)].add(part)


def _slices(
    samples: dict[int, _Samples], wanted: Sequence[SignalSource], slice_ns: int
) -> Iterator[SignalBlock]:
    """Cut the samples of a group of chunks into rounds of equal log time."""
    ready = {i: s.ordered() for i, s in samples.items() if any(map(len, s.log_ns))}
    if not ready:
        return
    first = min(int(c.log_ns[0]) for c in ready.values())
    last = max(int(c.log_ns[-1]) for c in ready.values())
    edges = np.arange(first + slice_ns, last + slice_ns + 1, slice_ns, dtype=np.int64)
    cuts = {i: np.searchsorted(c.log_ns, edges, side="left").tolist() for i, c in ready.items()}
    stamped = {i: bool(c.stamped.all()) for i, c in ready.items()}
    begins = dict.fromkeys(ready, 0)
    for number in range(len(edges)):
        for i, column in ready.items():
            begin, end = begins[i], cuts[i][number]
            begins[i] = end
            if end > begin:
                part = slice(begin, end)
                yield SignalBlock(
                    wanted[i].signal,
                    column.stamp_ns[part],
                    column.values[part],
                    stamped[i] or bool(column.stamped[part].all()),
                    column.log_ns[part],
                )


def _check_counts(file: McapFile, columns: Sequence[_Column]) -> None:
    statistics = file.summary.statistics
    if statistics is None:
        return
    for column in columns:
        counted = statistics.counts.get(column.channel, 0)
        if column.read != counted:
            msg = (
                f"{file.path}: topic '{column.source.topic}': {column.read} messages "
                "read, its summary counts "
                f"{counted}; the file is damaged, rewrite it with 'mcap recover'"
            )
            raise BagError(msg)


def read_texts(path: str | Path, topic: str) -> list[tuple[int, str]]:
    """Return log times [ns] and texts of a std_msgs/msg/String topic; empty if it is not there.

    Raises
    ------
    BagError
        If the bag cannot be read.
    """
    found: list[tuple[int, str]] = []
    names, _ = bag_files(path)
    with ExitStack() as stack:
        for name in names:
            file = _opened(name, stack)
            for channel in file.summary.channels.values():
                if topic_name(channel.topic) != topic:
                    continue
                types = _types(file, channel)
                for chunk in file.summary.chunks:
                    for message in messages(file.chunk(chunk), {channel.id}):
                        decoded = types.decode(message.data, message.log_ns)
                        found.append((message.log_ns, str(decoded.data)))
    return sorted(found)
