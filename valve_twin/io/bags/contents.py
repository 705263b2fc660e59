# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is in a bag: its files, topics, types and counts, according to the summaries."""

from __future__ import annotations

import logging
from collections import Counter
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.core.quantity import nearest
from valve_twin.io.bags.folder import BagFolder, bag_files, bag_folder
from valve_twin.io.bags.metadata import FILE_NAME
from valve_twin.io.cdr.bag_types import BagTypes
from valve_twin.io.cdr.message_types import known_type_name
from valve_twin.io.errors import BagError, IndexLiesError
from valve_twin.io.mcap.reader import McapFile
from valve_twin.io.salvage.read import known, salvage

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mcap.records import Channel


_LOGGER = logging.getLogger("valve_twin")
_TOLD = 3  # topics of a line
_COMPARED: set[tuple[Path, int, int]] = set()
"""Files that were compared with what they state and found sound, with time and size."""


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
    folder = bag_folder(path)
    custom = dict(folder.custom)
    with ExitStack() as stack:
        opened = [open_file(f, stack) for f in folder.files]
        for file in opened:
            custom = {**file.summary.metadata.get("valve_twin", {}), **custom}
        info = contents(Path(path), opened, custom)
        tell_counts(folder, opened, info)
        return info


def open_file(path: Path, stack: ExitStack) -> McapFile:
    """Open a file until the stack is left; of a damaged one what is intact is read."""
    file = McapFile(path, salvage=salvage, salvaged=known(path))
    stack.callback(file.close)
    return file


def wrong_counts(folder: BagFolder, opened: Sequence[McapFile], info: BagInfo) -> str:
    """Return how metadata and sound files disagree upon the number of messages, empty = not.

    Parameters
    ----------
    folder : BagFolder
        What the metadata says.
    opened : sequence of McapFile
        The files.
    info : BagInfo
        What they hold.
    """
    damaged = any(f.damage is not None and f.damage.losses for f in opened)
    unknown = min(info.message_count, *(t.count for t in info.topics), 0) < 0
    if not folder.counts or damaged or unknown:
        return ""
    held = Counter({t.name: t.count for t in info.topics})
    stated = Counter({topic_name(name): n for name, n in folder.counts.items()})
    wrong = sorted(name for name in {*held, *stated} if held[name] != stated[name])
    if not wrong:
        return ""
    told = "; ".join(
        f"counts {stated[name]} messages of {name}, its files hold {held[name]}"
        for name in wrong[:_TOLD]
    )
    more = f"; {len(wrong) - _TOLD} more topics likewise" if len(wrong) > _TOLD else ""
    return f"{folder.files[0].parent / FILE_NAME}: {told}{more}"


def tell_counts(folder: BagFolder, opened: Sequence[McapFile], info: BagInfo) -> None:
    """Say on the log where metadata counts otherwise than its files.

    Parameters
    ----------
    folder, opened, info
        As of `wrong_counts`.
    """
    if line := wrong_counts(folder, opened, info):
        _LOGGER.warning("%s", line)


def contents(path: Path, opened: Sequence[McapFile], custom: dict[str, str]) -> BagInfo:
    """Return what open files hold.

    Parameters
    ----------
    path : Path
        The bag, as given.
    opened : sequence of McapFile
        Its files in their order.
    custom : dict
        Values of the user's own.
    """
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
        counts = {} if statistics is None else statistics.counts
        told = statistics is not None and sum(counts.values()) == statistics.message_count
        for channel in summary.channels.values():  # a writer need not say how many each has
            _add_topic(topics, file, channel, counts.get(channel.id, 0) if told else -1)
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


def _add_topic(topics: dict[str, TopicInfo], file: McapFile, channel: Channel, count: int) -> None:
    name = topic_name(channel.topic)
    schema = file.summary.schemas.get(channel.schema_id)
    before = topics.get(name)
    if before is not None:
        count = -1 if min(count, before.count) < 0 else count + before.count
    topics[name] = TopicInfo(
        name,
        known_type_name(schema.name) if schema else "",
        count,
        channel.metadata.get("offered_qos_profiles", ""),
    )


def bag_types(path: str | Path, topic: str) -> BagTypes:
    """Return the types of a topic as the bag defines them.

    Raises
    ------
    BagError
        If the bag cannot be read or has no such topic.
    """
    files, _ = bag_files(path)
    with ExitStack() as stack:
        for name in files:
            file = open_file(name, stack)
            for channel in file.summary.channels.values():
                if topic_name(channel.topic) == topic_name(topic):
                    return channel_types(file, channel)
    raise missing_topic(path, topic, "", [t.name for t in bag_info(path).topics])


def channel_types(file: McapFile, channel: Channel) -> BagTypes:
    """Return the types of a channel; BagError where the file does not define them."""
    place = f"{file.path}: topic '{channel.topic}'"
    schema = file.summary.schemas.get(channel.schema_id)
    if schema is None:
        msg = f"{place}: the file holds no definition of its type; record the topic anew"
        raise BagError(msg)
    if channel.message_encoding != "cdr":
        msg = (
            f"{place}: encoding '{channel.message_encoding}' is not read; record the topic with "
            "ROS 2 (cdr)"
        )
        raise BagError(msg)
    return BagTypes(schema, place)


def missing_topic(path: str | Path, topic: str, what: str, names: Sequence[str]) -> BagError:
    """Return the error that names a topic which is not there and the nearest that is.

    Parameters
    ----------
    path : path
        The bag.
    topic : str
        What is missing.
    what : str
        What it was wanted for, to follow its name; may be empty.
    names : sequence of str
        The topics that there are.
    """
    near = nearest(topic, names)
    there = f"there are {', '.join(names)}" if names else "there are none"
    hint = there if near is None else f"did you mean '{near}'? {there}"
    return BagError(f"{path}: topic '{topic}'{what} is not in the bag; {hint}")


def compare_with_data(path: str | Path) -> None:
    """Read every chunk of a bag and compare it with what is stated of it; say what differs.

    Whoever opens the bag afterwards reads a file that lies by its data section.

    Raises
    ------
    BagError
        If the bag cannot be read.
    """
    for name in bag_files(path)[0]:
        with ExitStack() as stack, suppress(IndexLiesError):
            file = open_file(name, stack)
            state = name.stat()
            key = name, state.st_mtime_ns, state.st_size
            if key in _COMPARED:
                continue
            for chunk in file.summary.chunks:
                if file.is_sound:
                    file.chunk(chunk)
            if file.is_sound:
                _COMPARED.add(key)
