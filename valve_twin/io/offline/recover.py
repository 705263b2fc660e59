# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Rewrite a damaged bag as a sound one and verify what was written."""

from __future__ import annotations

import hashlib
import math
import shutil
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.io.bags.folder import find_files
from valve_twin.io.bags.qos import read_profiles
from valve_twin.io.bags.writer import BagWriter
from valve_twin.io.cdr.message_types import known_type_name
from valve_twin.io.errors import BagError
from valve_twin.io.mcap.reader import McapFile, messages
from valve_twin.io.salvage.read import salvage_file, salvaged_messages

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from mcap.records import Channel, Schema

    from valve_twin.io.mcap.damage import Loss, Salvage

_HEAD = struct.Struct("<QQQ")


@dataclass(frozen=True, slots=True)
class Recovery:
    """What was read of a bag, written and verified.

    Attributes
    ----------
    out : Path
        The new bag.
    topics : dict
        Messages by topic in the new bag.
    losses : tuple of Loss
        Damaged places of all files.
    lost_count : int or None
        Messages lost in all, None = unknown.
    lost : dict or None
        Messages lost by topic, None = unknown.
    unverified : int
        Messages for whose values no check sum stands.
    suspects : int
        Those of them with values that are not finite.
    notes : tuple of str
        What else is wrong.
    """

    out: Path
    topics: dict[str, int]
    losses: tuple[Loss, ...]
    lost_count: int | None
    lost: dict[str, int] | None
    unverified: int
    suspects: int
    notes: tuple[str, ...]

    @property
    def count(self) -> int:
        """Messages in the new bag."""
        return sum(self.topics.values())


@dataclass(slots=True)
class Digests:
    """Counts and digests of messages by topic."""

    counts: dict[str, int] = field(default_factory=dict)
    _sums: dict[str, hashlib.blake2b] = field(default_factory=dict)

    def add(self, topic: str, log_ns: int, publish_ns: int, data: bytes) -> None:
        """Take one message.

        Parameters
        ----------
        topic : str
            Its topic.
        log_ns, publish_ns : int
            Receive time and source time [ns].
        data : bytes
            Serialized message.
        """
        if topic not in self._sums:
            self._sums[topic] = hashlib.blake2b(digest_size=16)
            self.counts[topic] = 0
        self._sums[topic].update(_HEAD.pack(log_ns, publish_ns, len(data)))
        self._sums[topic].update(data)
        self.counts[topic] += 1

    def values(self) -> dict[str, tuple[int, str]]:
        """Return count and digest by topic."""
        return {name: (self.counts[name], s.hexdigest()) for name, s in self._sums.items()}


def recover(path: str | Path, out: str | Path) -> Recovery:
    """Rewrite everything intact of a bag into a new folder, read it back and compare.

    The source is only read.

    Parameters
    ----------
    path : path
        Bag folder, metadata.yaml or .mcap file.
    out : path
        Folder to make; it must not exist.

    Returns
    -------
    Recovery
        What was written and what is lost.

    Raises
    ------
    BagError
        If nothing is intact, the new bag cannot be written, or it does not read back as written;
        then there is no new bag.
    """
    folder = find_files(path)
    notes = [folder.flaw] if folder.flaw else []
    notes += [f"{p}: the file is missing; all its messages are lost" for p in folder.missing]
    files = [p for p in folder.files if p not in folder.missing]
    found = [salvage_file(file) for file in files]
    if not any(s.summary.chunks for s in found):
        lines = [loss.line() for s in found for loss in s.losses]
        msg = f"{path}: nothing in it can be recovered; {lines[0] if lines else 'it is empty'}"
        raise BagError(msg)
    unknown = bool(folder.missing) or any(s.lost_count is None for s in found)
    lost_count = None if unknown else sum(s.lost_count or 0 for s in found)
    out = Path(out)
    written = _write(out, found, _custom(folder.custom, found, Path(path), lost_count), notes)
    try:
        verify(out, written)
    except BagError:
        shutil.rmtree(out)
        raise
    return Recovery(
        out,
        dict(written.counts),
        tuple(loss for s in found for loss in s.losses),
        lost_count,
        None if unknown else _summed(found),
        sum(s.unverified_count for s in found),
        sum(s.suspects for s in found),
        tuple(notes),
    )


def verify(path: Path, expected: Digests) -> None:
    """Read a bag back and compare counts and contents by topic.

    Raises
    ------
    BagError
        If it does not hold what it should.
    """
    found = Digests()
    for file in find_files(path).files:
        opened = McapFile(file)
        try:
            names = {i: c.topic for i, c in opened.summary.channels.items()}
            for chunk in opened.summary.chunks:
                for m in messages(opened.chunk(chunk), set(names)):
                    found.add(names[m.channel], m.log_ns, m.publish_ns, m.data)
        finally:
            opened.close()
    if found.values() != expected.values():
        msg = f"{path}: does not read back as it was written; check the disk and try again"
        raise BagError(msg)


def _write(
    out: Path, found: Sequence[Salvage], custom: Mapping[str, str], notes: list[str]
) -> Digests:
    written = Digests()
    bag = BagWriter(out, flush_s=math.inf)
    try:
        with bag:
            bag.note(custom)
            for part in found:
                _copy(part, bag, written, notes)
    except BaseException:
        shutil.rmtree(out, ignore_errors=True)
        raise
    return written


def _copy(part: Salvage, bag: BagWriter, written: Digests, notes: list[str]) -> None:
    names: dict[int, str] = {}
    for number, channel in part.summary.channels.items():
        problem = declare(bag, channel, part.summary.schemas.get(channel.schema_id))
        if problem:
            notes.append(f"{part.path}: topic '{channel.topic}' is left out: {problem}")
        else:
            names[number] = channel.topic
    for message, _ in salvaged_messages(part.path, part):
        name = names.get(message.channel)
        if name is None:
            continue
        bag.write(name, message.data, log_ns=message.log_ns, publish_ns=message.publish_ns)
        written.add(name, message.log_ns, message.publish_ns, message.data)


def declare(bag: BagWriter, channel: Channel, schema: Schema | None) -> str:
    """Add a topic as its file describes it; return why it cannot be, empty = it is.

    Parameters
    ----------
    bag : BagWriter
        Where it is to be written.
    channel : Channel
        The topic in its file.
    schema : Schema, optional
        Its type; None where the file holds none.
    """
    if channel.message_encoding != "cdr":
        return f"its encoding '{channel.message_encoding}' is none of ROS 2"
    if schema is None:
        return "the file holds no definition of its type"
    try:
        bag.add_topic(
            channel.topic,
            known_type_name(schema.name),
            qos=read_profiles(channel.metadata.get("offered_qos_profiles", "")),
            message_definition=schema.data.decode(errors="replace"),
            definition_hash=channel.metadata.get("topic_type_hash", ""),
            encoding=schema.encoding,
        )
    except BagError as err:
        return str(err)
    return ""


def _custom(
    custom: Mapping[str, str], found: Sequence[Salvage], path: Path, lost: int | None
) -> dict[str, str]:
    inside = {k: v for s in found for k, v in s.summary.metadata.get("valve_twin", {}).items()}
    return {
        **inside,
        **custom,
        "recovered_from": path.resolve().name,
        "recovered_lost_messages": "unknown" if lost is None else str(lost),
        "recovered_unverified_messages": str(sum(s.unverified_count for s in found)),
    }


def _summed(found: Sequence[Salvage]) -> dict[str, int] | None:
    summed: dict[str, int] = {}
    for part in found:
        if part.lost is None:
            return None
        for name, n in part.lost.items():
            summed[name] = summed.get(name, 0) + n
    return summed
