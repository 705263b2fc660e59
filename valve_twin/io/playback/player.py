# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read whole messages of a bag in log-time order, undecoded, to be published again.

The files of a split bag are read as one. A chunk is unpacked when its first message is due, so
that a long bag needs the memory of the chunks that overlap in time, not of the bag.
"""

from __future__ import annotations

import heapq
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import chain
from operator import attrgetter
from typing import TYPE_CHECKING

from valve_twin.io.bags.contents import compare_with_data, open_file, topic_name
from valve_twin.io.bags.folder import bag_files
from valve_twin.io.bags.qos import QosProfile, read_offer
from valve_twin.io.cdr.message_types import known_type_name
from valve_twin.io.errors import BagError
from valve_twin.io.mcap.mapped import unreadable
from valve_twin.io.mcap.reader import messages
from valve_twin.io.playback.choice import Choice
from valve_twin.io.playback.types import BagType, problem

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator, Mapping, Sequence
    from pathlib import Path

    from mcap.records import Channel

    from valve_twin.io.mcap.format import ChunkIndex
    from valve_twin.io.mcap.reader import McapFile


COMPARED_B = 16_000_000
"""Largest bag that is read once before it is played [B]: half a million samples, 2 s."""


@dataclass(frozen=True, slots=True)
class BagMessage:
    """One message as recorded; times in ns."""

    topic: str
    log_ns: int
    publish_ns: int
    data: bytes


@dataclass(frozen=True, slots=True)
class BagTopic:
    """One topic of a bag.

    Attributes
    ----------
    name : str
        Absolute name.
    type : str
        Full type name.
    qos : QosProfile
        What its publishers offered.
    types : tuple of BagType
        Its definitions; more than one where files of the bag differ.
    """

    name: str
    type: str
    qos: QosProfile
    types: tuple[BagType, ...] = ()

    @property
    def problem(self) -> str:
        """Why it cannot be played here, empty where it can."""
        names = sorted({t.name for t in self.types})
        if len(names) > 1:
            return f"it has several types ({', '.join(names)}); cut the bag between them"
        return next(filter(None, map(problem, self.types)), "")


def bag_topics(path: str | Path, wanted: Sequence[str] | Choice = ()) -> list[BagTopic]:
    """Return the topics of a bag by name.

    Parameters
    ----------
    path : path
        The bag.
    wanted : sequence of str or Choice
        Only these; empty = all.

    Raises
    ------
    BagError
        If the bag cannot be read, holds nothing or lacks a wanted topic; names the nearest.
    ConfigError
        If the choice holds no regular expression where it should.
    """
    found: dict[str, list[tuple[BagType, str]]] = {}
    with ExitStack() as stack:
        for file in _opened(path, stack):
            for channel in file.summary.channels.values():
                entry = (_type(file, channel), channel.metadata.get("offered_qos_profiles", ""))
                found.setdefault(topic_name(channel.topic), []).append(entry)
    if not found:
        msg = f"{path}: the bag is empty; record it again"
        raise BagError(msg)
    choice = wanted if isinstance(wanted, Choice) else Choice(topics=tuple(wanted))
    return [_topic(name, found[name]) for name in choice.of(sorted(found), str(path))]


def compare_small(path: str | Path) -> None:
    """Compare a bag with what it states of itself before it is played, where that takes no time.

    Parameters
    ----------
    path : path
        The bag; above `COMPARED_B` it is compared chunk by chunk on the way.

    Raises
    ------
    BagError
        If the bag cannot be read.
    """
    try:
        size = sum(file.stat().st_size for file in bag_files(path)[0])
    except OSError as err:
        raise unreadable(path, err) from err
    if size <= COMPARED_B:
        compare_with_data(path)


def _topic(name: str, entries: list[tuple[BagType, str]]) -> BagTopic:
    types = tuple(dict.fromkeys(t for t, _ in entries))
    offers = "\n".join(dict.fromkeys(text for _, text in entries if text))
    return BagTopic(name, types[0].name, read_offer(offers), types)


def _type(file: McapFile, channel: Channel) -> BagType:
    schema = file.summary.schemas.get(channel.schema_id)
    stated_hash = channel.metadata.get("topic_type_hash", "")
    if schema is None:
        return BagType("", channel.message_encoding, "", "", stated_hash)
    name = known_type_name(schema.name)
    text = schema.data.decode(errors="replace")
    return BagType(name, channel.message_encoding, schema.encoding, text, stated_hash)


def _opened(path: str | Path, stack: ExitStack) -> list[McapFile]:
    return [open_file(name, stack) for name in bag_files(path)[0]]


def read_messages(
    path: str | Path, topics: Sequence[str], *, from_ns: int = 0, until_ns: int | None = None
) -> Generator[BagMessage, None, None]:
    """Yield the messages of some topics by log time; equal times keep the order of the file.

    Parameters
    ----------
    path : path
        The bag.
    topics : sequence of str
        Absolute names.
    from_ns : int
        Earliest log time [ns].
    until_ns : int, optional
        Latest log time [ns], default the end.

    Raises
    ------
    BagError
        If the bag cannot be read.
    """
    with ExitStack() as stack:
        places = _places(_opened(path, stack))
        for message in _merged([p for p in places if p.end_ns >= from_ns], set(topics)):
            if until_ns is not None and message.log_ns > until_ns:
                return
            if message.log_ns >= from_ns:
                yield message


def latched_before(
    path: str | Path, depths: Mapping[str, int], before_ns: int
) -> list[BagMessage]:
    """Return the last messages of some topics before a log time, by log time.

    Parameters
    ----------
    path : path
        The bag.
    depths : mapping of str to int
        How many of each topic, by absolute name.
    before_ns : int
        Log time that is not included [ns].

    Raises
    ------
    BagError
        If the bag cannot be read.
    """
    found: dict[str, list[BagMessage]] = {name: [] for name in depths}
    with ExitStack() as stack:
        places = _places(_opened(path, stack))
        for place in sorted(places, key=attrgetter("end_ns"), reverse=True):
            if place.start_ns >= before_ns:
                continue
            missing = {n for n, depth in depths.items() if _may_add(found[n], depth, place)}
            if not missing & place.topics:
                continue
            for message in place.messages(missing):
                if message.log_ns < before_ns:
                    found[message.topic].append(message)
            for name in missing:
                found[name].sort(key=_log_time)
                del found[name][: -depths[name]]
    return sorted((m for kept in found.values() for m in kept), key=_log_time)


@dataclass(frozen=True, slots=True)
class _Place:
    """A chunk, or what lies outside chunks, of one file."""

    start_ns: int
    end_ns: int
    file: McapFile
    chunk: ChunkIndex | None
    topics: frozenset[str]

    def messages(self, topics: set[str]) -> Iterator[BagMessage]:
        """Yield the messages of some topics in file order."""
        names = {i: topic_name(c.topic) for i, c in self.file.summary.channels.items()}
        wanted = {i for i, name in names.items() if name in topics}
        chunk = self.chunk
        pieces = self.file.loose_messages() if chunk is None else (self.file.chunk(chunk),)
        for m in chain.from_iterable(messages(data, wanted) for data in pieces):
            yield BagMessage(names[m.channel], m.log_ns, m.publish_ns, bytes(m.data))


_log_time = attrgetter("log_ns")


def _may_add(kept: Sequence[BagMessage], depth: int, place: _Place) -> bool:
    """Whether a place may hold a later message than the oldest that is kept."""
    return len(kept) < depth or place.end_ns >= kept[0].log_ns


def _places(opened: Sequence[McapFile]) -> list[_Place]:
    """Return all places by time; what an index says of their topics is a hint."""
    found = []
    for file in opened:
        names = {i: topic_name(c.topic) for i, c in file.summary.channels.items()}
        for chunk in file.summary.chunks:
            indexed = {names[i] for i in chunk.message_indexes if i in names}
            inside = frozenset(indexed or names.values())
            found.append(_Place(chunk.start_ns, chunk.end_ns, file, chunk, inside))
        if not file.summary.chunks:
            everything = frozenset(names.values())
            found.append(_Place(0, 2**63, file, None, everything))
    return sorted(found, key=attrgetter("start_ns", "end_ns"))


def _merged(places: Sequence[_Place], topics: set[str]) -> Iterator[BagMessage]:
    """Merge the messages of places that overlap; unpack a place when it is due."""
    waiting = iter(places)
    coming = next(waiting, None)
    heads: list[tuple[int, int, int, list[BagMessage]]] = []
    number = 0
    while heads or coming is not None:
        while coming is not None and (not heads or coming.start_ns <= heads[0][0]):
            batch = sorted(coming.messages(topics), key=_log_time)
            if batch:
                heapq.heappush(heads, (batch[0].log_ns, number, 0, batch))
            number += 1
            coming = next(waiting, None)
        if not heads:
            continue
        _, order, at, batch = heapq.heappop(heads)
        limit = min(
            heads[0][0] if heads else 2**63, coming.start_ns - 1 if coming is not None else 2**63
        )
        yield batch[at]
        at += 1
        while at < len(batch) and batch[at].log_ns < limit:
            yield batch[at]
            at += 1
        if at < len(batch):
            heapq.heappush(heads, (batch[at].log_ns, order, at, batch))
