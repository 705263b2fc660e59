# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Signals of a bag as columns, whole or in rounds of log time.

Where the layout of a message type allows it, a compiled walk takes the mapped fields straight out
of the chunks; chunks that hold something odd, and types that only the general decoder reads, go
through it with the same result.
"""

from __future__ import annotations

import logging
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.io.bags.contents import (
    channel_types,
    contents,
    missing_topic,
    open_file,
    tell_counts,
    topic_name,
)
from valve_twin.io.bags.folder import bag_folder
from valve_twin.io.cdr.columns import Columns, ColumnStore, FieldPlan, Walker, pays
from valve_twin.io.cdr.layout import layout_of
from valve_twin.io.cdr.signals import Extractor, SignalBlock, SignalSource
from valve_twin.io.errors import BagError, IndexLiesError
from valve_twin.io.mcap.index_check import Flaw
from valve_twin.io.mcap.reader import messages

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from valve_twin.core.types import IntArray
    from valve_twin.io.bags.contents import BagInfo
    from valve_twin.io.cdr.bag_types import BagTypes
    from valve_twin.io.mcap.format import ChunkIndex
    from valve_twin.io.mcap.reader import McapFile

SLICE_S = 1.0
"""Log time in one round of blocks [s]: below the default of hold_back_s, so that no signal waits
for another in vain."""

_LOGGER = logging.getLogger("valve_twin")
_BATCH_SIZE = 4 << 20
_MAX_EMPTY = 4_000_000
"""Rounds without samples that are gone through one by one: 46 days of seconds."""

_MAX_CAPACITY = 1 << 24
_LAST_NS = 2**63 - 1


@dataclass(frozen=True, slots=True)
class _Field:
    """One signal of one channel of one file; `row` is its place among the wanted ones."""

    row: int
    channel: int
    source: SignalSource
    extractor: Extractor
    types: BagTypes


@dataclass(slots=True)
class _Part:
    """One file with what is wanted of it.

    Attributes
    ----------
    file : McapFile
        The open file.
    fields, slow : list of _Field
        What is wanted of it, and what of that only the general decoder reads.
    read : (R, 4) int64 array
        Messages read and batches whose period cannot be, by row.
    """

    file: McapFile
    fields: list[_Field]
    read: IntArray
    walker: Walker | None = None
    slow: list[_Field] = field(default_factory=list)
    channels: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True)
class _Bag:
    """An open bag with what is wanted of it."""

    stack: ExitStack
    parts: list[_Part]
    wanted: list[SignalSource]
    capacity: int
    info: BagInfo


def read_signals(
    path: str | Path,
    sources: Iterable[SignalSource],
    *,
    slice_s: float = SLICE_S,
    on_open: Callable[[BagInfo], None] = lambda _: None,
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
    on_open : callable
        Is told what the bag holds, before anything is read.

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
    bag = _open(path, wanted)
    on_open(bag.info)
    return _blocks_again(path, bag, max(1, round(slice_s * 1e9)))


def read_columns(path: str | Path, sources: Iterable[SignalSource]) -> list[Columns]:
    """Return all samples of some signals of a bag, each in log-time order.

    Parameters
    ----------
    path : path
        Bag folder, metadata.yaml or .mcap file.
    sources : iterable of SignalSource
        What is wanted; several may share a topic.

    Returns
    -------
    list of Columns
        One a source, in their order.

    Raises
    ------
    BagError, ConfigError
        As `read_signals`.
    """
    wanted = list(sources)
    try:
        return _columns(_open(path, wanted))
    except IndexLiesError:
        return _columns(_open(path, wanted))


def _columns(bag: _Bag) -> list[Columns]:
    store = ColumnStore(bag.wanted, bag.capacity)
    with bag.stack:
        for group in _groups(bag.parts):
            for part, chunk in group:
                _read_chunk(part, chunk, store)
        _check_counts(bag)
    found = store.take()
    return [found[i] if i in found else _no_samples() for i in range(len(bag.wanted))]


def _no_samples() -> Columns:
    none = np.empty(0, dtype=np.int64)
    return Columns(none, none, np.empty(0), np.empty(0, dtype=np.bool_))


def _open(path: str | Path, wanted: list[SignalSource]) -> _Bag:
    """Open a bag and check topics, types and fields."""
    folder = bag_folder(path)
    with ExitStack() as stack:
        files = [open_file(name, stack) for name in folder.files]
        info = contents(Path(path), files, {})
        tell_counts(folder, files, info)
        parts = [_Part(f, _fields_of(f, wanted), _none_read(len(wanted))) for f in files]
        counts = _check_topics(info, wanted)
        known = -1 if -1 in counts else sum(counts)
        for part in parts:
            _choose(part, compiled=pays(known))
        capacity = _capacity(files, wanted, max(counts, default=0))
        return _Bag(stack.pop_all(), parts, wanted, capacity, info)
    raise AssertionError


def _capacity(files: Sequence[McapFile], wanted: Sequence[SignalSource], count: int) -> int:
    """Return for how many samples to make room at first; memory that stays empty costs nothing."""
    sizes = [chunk.size for file in files for chunk in file.summary.chunks]
    if any(source.batched for source in wanted):
        return min(sum(sizes) // 8, _MAX_CAPACITY)
    return min(count + max(sizes, default=0) // 32, _MAX_CAPACITY)


def _none_read(rows: int) -> IntArray:
    return np.zeros((rows, 4), dtype=np.int64)


def _fields_of(file: McapFile, wanted: Sequence[SignalSource]) -> list[_Field]:
    fields = []
    for channel in file.summary.channels.values():
        rows = [i for i, s in enumerate(wanted) if topic_name(channel.topic) == s.topic]
        if not rows:
            continue
        types = channel_types(file, channel)
        for row in rows:
            source = wanted[row]
            if source.type != types.name:
                msg = (
                    f"{file.path}: topic '{source.topic}' is of type {types.name}, not "
                    f"{source.type}; "
                    f"write signals.{source.signal}.type: {types.name}"
                )
                raise BagError(msg)
            # the store scales when samples are taken out of it
            extractor = Extractor(replace(source, scale=1.0, offset=0.0), types, str(file.path))
            fields.append(_Field(row, channel.id, source, extractor, types))
    return fields


def _choose(part: _Part, *, compiled: bool) -> None:
    """Decide which fields the compiled walk reads; a row goes there with all its channels."""
    found = {id(f): layout_of(f.source, f.types) if compiled else None for f in part.fields}
    slow = {f.row for f in part.fields if found[id(f)] is None}
    part.slow = [f for f in part.fields if f.row in slow]
    plans = [
        FieldPlan(f.row, f.channel, layout)
        for f in part.fields
        if f.row not in slow and (layout := found[id(f)]) is not None
    ]
    channels = part.file.summary.channels
    part.walker = Walker(plans, part.read, channels) if plans else None
    part.channels = frozenset(f.channel for f in part.fields)


def _check_topics(info: BagInfo, wanted: Sequence[SignalSource]) -> list[int]:
    """Return how many messages the topic of each signal has, -1 = unknown."""
    path, counts = info.path, {t.name: t.count for t in info.topics}
    for source in wanted:
        if source.topic not in counts:
            raise missing_topic(path, source.topic, f" of signal '{source.signal}'", list(counts))
        if counts[source.topic] == 0:
            msg = (
                f"{path}: topic '{source.topic}' of signal '{source.signal}' has no messages; "
                "check that its publisher ran, or map another topic"
            )
            raise BagError(msg)
    return [counts[source.topic] for source in wanted]


def _blocks_again(path: str | Path, bag: _Bag, slice_ns: int) -> Iterator[SignalBlock]:
    """Yield all blocks; begin anew where the bag states wrong times and nothing was yielded."""
    given = False
    try:
        for block in _blocks(bag, slice_ns):
            given = True
            yield block
    except IndexLiesError:
        if given:
            raise
        yield from _blocks(_open(path, bag.wanted), slice_ns)


def _blocks(bag: _Bag, slice_ns: int) -> Iterator[SignalBlock]:
    with bag.stack:
        store = ColumnStore(bag.wanted)
        size = 0
        for group in _groups(bag.parts):
            for part, chunk in group:
                size += _read_chunk(part, chunk, store)
            if size >= _BATCH_SIZE:
                yield from _slices(store.take(), bag.wanted, slice_ns)
                size = 0
        yield from _slices(store.take(), bag.wanted, slice_ns)
        _check_counts(bag)


def _groups(parts: Sequence[_Part]) -> Iterator[list[tuple[_Part, ChunkIndex | None]]]:
    """Yield chunks of all files in order of time; those that overlap in time come together."""
    if any(not part.file.summary.chunks for part in parts):
        yield [(part, c) for part in parts for c in part.file.summary.chunks or (None,)]
        return
    ordered = sorted(
        (
            (c.start_ns, c.end_ns, n, i)
            for n, part in enumerate(parts)
            for i, c in enumerate(part.file.summary.chunks)
        )
    )
    group: list[tuple[_Part, ChunkIndex | None]] = []
    until = -1
    for start, end, n, i in ordered:
        if group and start > until:
            yield group
            group = []
        group.append((parts[n], parts[n].file.summary.chunks[i]))
        until = max(until, end)
    if group:
        yield group


def _read_chunk(part: _Part, chunk: ChunkIndex | None, store: ColumnStore) -> int:
    """Add the samples of a chunk to the store; return its size [B], 0 where nothing is wanted."""
    if chunk is None:
        return sum(_read_data(part, piece, store) for piece in part.file.loose_messages())
    file = part.file
    data = file.chunk_view(chunk)
    if part.walker is None or not file.sum_stands:
        return _read_data(part, file.chunk(chunk), store)
    size = _read_data(part, data, store, None if file.damage is not None else chunk)
    flaw, late = part.walker.flaw, None
    if flaw is Flaw.LATE:  # as in each chunk of a writer that repeats its definitions
        late = part.walker.late_definitions(data)
    if flaw is not Flaw.NONE and (late is None or not all(map(file.defined.holds, late))):
        file.doubt(chunk, file.flaw_of(chunk, data))
    return size


def _read_data(
    part: _Part, data: bytes | memoryview, store: ColumnStore, chunk: ChunkIndex | None = None
) -> int:
    """Add the samples of some records to the store; return their size [B]."""
    slow = part.slow
    if part.walker is not None:
        odd = part.walker.take(data, store, part.file.content, chunk)
        if odd:
            slow = [*slow, *(f for f in part.fields if f.row in odd)]
    if slow:
        _decode(data, slow, part.read, store)
    return len(data)


def _decode(
    data: bytes | memoryview, fields: Sequence[_Field], read: IntArray, store: ColumnStore
) -> None:
    """Decode message by message what the compiled walk does not read."""
    by_channel: dict[int, list[_Field]] = {}
    for one in fields:
        by_channel.setdefault(one.channel, []).append(one)
    for message in messages(data, set(by_channel)):
        group = by_channel[message.channel]
        if message.log_ns > _LAST_NS:
            one = group[0]
            msg = (
                f"{one.types.where}: a message has the log time "
                f"{message.log_ns} ns, which is beyond the year 2262; the file is damaged, "
                "rewrite it with 'valve-twin recover'"
            )
            raise BagError(msg)
        decoded = group[0].types.decode(message.data, message.log_ns)
        for one in group:
            block = one.extractor(decoded, message.log_ns)
            read[one.row, 0] += 1
            read[one.row, 1] += one.extractor.rejected
            one.extractor.rejected = 0
            store.append(
                one.row, message.log_ns, block.stamp_ns, block.values, stamped=block.has_header
            )


def cut_rounds(logs: Sequence[IntArray], slice_ns: int) -> Iterator[tuple[int, slice]]:
    """Cut columns into rounds of equal log time: yield the place of a column and its samples.

    Parameters
    ----------
    logs : sequence of (N,) int64 arrays
        Log times of each column, at least one, not decreasing [ns].
    slice_ns : int
        Log time in one round [ns].
    """
    edges = _edges(logs, slice_ns)
    cuts = [np.searchsorted(log, edges, side="left").tolist() for log in logs]
    begins = [0] * len(logs)
    for ends in zip(*cuts, strict=True):
        for place, end in enumerate(ends):
            if end > begins[place]:
                yield place, slice(begins[place], end)
                begins[place] = end


def _edges(logs: Sequence[IntArray], slice_ns: int) -> IntArray:
    """Return the ends of the rounds [ns]; where a stray time is far off only those in use."""
    first, last = min(int(log[0]) for log in logs), max(int(log[-1]) for log in logs)
    if (last - first) // slice_ns < _MAX_EMPTY + sum(map(len, logs)):
        return np.arange(first + slice_ns, last + slice_ns + 1, slice_ns, dtype=np.int64)
    rounds = [np.unique((log - first) // slice_ns) for log in logs]
    return first + (np.unique(np.concatenate(rounds)) + 1) * slice_ns


def _slices(
    ready: dict[int, Columns], wanted: Sequence[SignalSource], slice_ns: int
) -> Iterator[SignalBlock]:
    """Cut the samples of a group of chunks into rounds of equal log time."""
    if not ready:
        return
    rows = list(ready)
    stamped = [bool(c.stamped.all()) for c in ready.values()]
    for place, part in cut_rounds([c.log_ns for c in ready.values()], slice_ns):
        column = ready[rows[place]]
        yield SignalBlock(
            wanted[rows[place]].signal,
            column.stamp_ns[part],
            column.values[part],
            stamped[place] or bool(column.stamped[part].all()),
            column.log_ns[part],
        )


def _check_counts(bag: _Bag) -> None:
    """Refuse a bag that holds fewer messages than it says; tell of batches that were left out."""
    for part in bag.parts:
        for row in np.flatnonzero(part.read[:, 1]).tolist():
            _LOGGER.warning(
                "%s: topic '%s': %d of %d batches have no period that can be; their samples were "
                "left out: publish the time between two samples as 'period' [s]",
                part.file.path,
                bag.wanted[row].topic,
                part.read[row, 1],
                part.read[row, 0],
            )
        statistics = part.file.summary.statistics
        if statistics is None or not statistics.counts or part.file.damage is not None:
            continue
        for row in {f.row for f in part.fields}:
            read = int(part.read[row, 0])
            channels = {f.channel for f in part.fields if f.row == row}
            counted = sum(statistics.counts.get(channel, 0) for channel in channels)
            if read != counted:
                msg = (
                    f"{part.file.path}: topic '{bag.wanted[row].topic}': {read} messages "
                    "read, its summary counts "
                    f"{counted}; the file is damaged, rewrite it with 'valve-twin recover'"
                )
                raise BagError(msg)
