# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read whole messages of a bag in log-time order, undecoded, to be published again."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import yaml

from valve_twin.io.bags import bag_files, bag_info, topic_name
from valve_twin.io.errors import BagError, suggest
from valve_twin.io.mcap_format import ChunkIndex
from valve_twin.io.mcap_reader import McapFile, messages
from valve_twin.io.metadata import QosProfile

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path


@dataclass(frozen=True, slots=True)
class BagMessage:
    """One message as recorded; times in ns."""

    topic: str
    log_ns: int
    publish_ns: int
    data: bytes


@dataclass(frozen=True, slots=True)
class BagTopic:
    """One topic that can be played, with what its publisher offered."""

    name: str
    type: str
    qos: QosProfile


def bag_topics(path: str | Path, wanted: Sequence[str] = ()) -> list[BagTopic]:
    """Return the topics of a bag.

    Parameters
    ----------
    path : path
        The bag.
    wanted : sequence of str
        Only these; empty = all.

    Raises
    ------
    BagError
        If the bag cannot be read, holds nothing or lacks a wanted topic; names the nearest.
    """
    found = {t.name: t for t in bag_info(path).topics}
    for name in wanted:
        if name not in found:
            msg = f"{path}: there is no topic '{name}'; {suggest(name, found)}"
            raise BagError(msg)
    if not found:
        msg = f"{path}: the bag is empty; record it again"
        raise BagError(msg)
    return [
        BagTopic(t.name, t.type, _offered(t.qos))
        for t in found.values()
        if not wanted or t.name in wanted
    ]


def read_messages(
    path: str | Path, topics: Sequence[str], *, from_ns: int = 0
) -> Iterator[BagMessage]:
    """Yield the messages of some topics by log time; equal times keep the order of the file.

    Parameters
    ----------
    path : path
        The bag.
    topics : sequence of str
        Absolute names.
    from_ns : int
        Earliest log time [ns].

    Raises
    ------
    BagError
        If the bag cannot be read.
    """
    files, _ = bag_files(path)
    with ExitStack() as stack:
        opened = []
        for name in files:
            opened.append(McapFile(name))
            stack.callback(opened[-1].close)
        for group in _together(opened, from_ns):
            found = [m for file, chunk in group for m in _of_chunk(file, chunk, set(topics))]
            found.sort(key=lambda m: m.log_ns)
            yield from (m for m in found if m.log_ns >= from_ns)


_Place = tuple[McapFile, ChunkIndex | None]


def _together(opened: list[McapFile], from_ns: int) -> Iterator[list[_Place]]:
    """Yield chunks in order of time; those that overlap come together."""
    if any(not f.summary.chunks for f in opened):
        yield [(f, c) for f in opened for c in (*f.summary.chunks,) or (None,)]
        return
    places = [(c.start_ns, c.end_ns, f, c) for f in opened for c in f.summary.chunks]
    group: list[_Place] = []
    until = -1
    for start, end, file, chunk in sorted(places, key=lambda p: p[:2]):
        if end < from_ns:
            continue
        if group and start > until:
            yield group
            group = []
        group.append((file, chunk))
        until = max(until, end)
    if group:
        yield group


def _of_chunk(file: McapFile, chunk: ChunkIndex | None, topics: set[str]) -> Iterator[BagMessage]:
    names = {i: topic_name(c.topic) for i, c in file.summary.channels.items()}
    wanted = {i for i, name in names.items() if name in topics}
    data = file.loose_messages() if chunk is None else file.chunk(chunk)
    for m in messages(data, wanted):
        yield BagMessage(names[m.channel], m.log_ns, m.publish_ns, m.data)


_RELIABILITY = {1: "reliable", 2: "best_effort"}
_DURABILITY = {1: "transient_local", 2: "volatile"}


def _offered(text: str) -> QosProfile:
    """Read what was offered; old bags write numbers, many write nothing."""
    try:
        profiles = yaml.safe_load(text) if text else None
    except yaml.YAMLError:
        profiles = None
    if not isinstance(profiles, list) or not profiles or not isinstance(profiles[0], dict):
        return QosProfile()
    first: dict[str, Any] = profiles[0]
    reliability, durability = first.get("reliability"), first.get("durability")
    depth = first.get("depth")
    return QosProfile(
        reliability=str(_RELIABILITY.get(reliability, reliability or "reliable")),  # type: ignore[arg-type]
        durability=str(_DURABILITY.get(durability, durability or "volatile")),  # type: ignore[arg-type]
        depth=depth if isinstance(depth, int) and depth > 0 else 10,
    )
