# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which tag goes to which topic, and what its values are in our units."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import TYPE_CHECKING, Any

from valve_twin.io.config.topic_names import resolve_topic
from valve_twin.io.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Sequence

MOST_TAGS = 1000
"""Tags of a node: each is a publisher of its own [1]."""

_EPOCH = datetime(1970, 1, 1)
_TICK_NS = 1000


@dataclass(frozen=True, slots=True)
class Tag:
    """A variable of the PLC and the topic that it feeds.

    Attributes
    ----------
    topic : str
        Absolute name.
    node : str
        Its node id, such as ns=3;s="Press"."Position".
    """

    topic: str
    node: str


@dataclass(frozen=True, slots=True)
class Sample:
    """A value of a tag.

    Attributes
    ----------
    tag : int
        Which one.
    stamp_ns : int
        Stamp of its source; else of the server; 0 = neither gave one [ns since 1970].
    value : float
        NaN where the status is not good or it is no number.
    lost_before : bool
        Whether the server says that its queue overflowed here.
    first : bool
        Whether it is the first after a connection: it may be as old as it likes.
    """

    tag: int
    stamp_ns: int
    value: float
    lost_before: bool = False
    first: bool = False


def read_tags(lines: Sequence[str], valve: str, prefix: str, *, where: str) -> tuple[Tag, ...]:
    """Return the tags of lines TOPIC NODE_ID.

    Parameters
    ----------
    lines : sequence of str
        One a tag.
    valve : str
        Namespace of the node, put before a relative topic.
    prefix : str
        Put before every topic.
    where : str
        Whose parameter it is, for messages.

    Raises
    ------
    ConfigError
        If there is none or too many, one is none of these or a topic is fed twice.
    """
    if len(lines) > MOST_TAGS:
        msg = (
            f"{where}: tags: {len(lines)} are given, a node takes {MOST_TAGS} at most: "
            "leave out what no twin takes, or start a node for each group of valves"
        )
        raise ConfigError(msg)
    found: list[Tag] = []
    for line in lines:
        topic, _, node = line.strip().partition(" ")
        if not node.strip():
            msg = f"{where}: tags: '{line}' is no tag: write TOPIC NODE_ID, as position ns=3;i=7"
            raise ConfigError(msg)
        found.append(Tag(resolve_topic(topic, valve, prefix), node.strip()))
    topics = [tag.topic for tag in found]
    if twice := next((t for t in topics if topics.count(t) > 1), ""):
        msg = f"{where}: tags: two tags feed {twice}: give each its own topic"
        raise ConfigError(msg)
    nodes = [tag.node for tag in found]
    if twice := next((n for n in nodes if nodes.count(n) > 1), ""):
        msg = f"{where}: tags: {twice} stands twice: let both take its one topic"
        raise ConfigError(msg)
    if not found:
        msg = f"{where}: tags: there is none: write lines TOPIC NODE_ID"
        raise ConfigError(msg)
    return tuple(found)


def to_sample(tag: int, data: Any, *, first: bool = False) -> Sample:
    """Return a sample of what a server notified.

    Parameters
    ----------
    tag : int
        Which tag.
    data : DataValue
        Value, status and stamps; Uncertain, Bad and infinite give NaN.
    first : bool
        Whether it is the first after a connection.
    """
    status = data.StatusCode
    good = status is None or status.is_good()
    raw = data.Value.Value if data.Value is not None else None
    number = float(raw) if good and isinstance(raw, (bool, int, float)) else math.nan
    value = number if math.isfinite(number) else math.nan
    stamps = (data.SourceTimestamp, data.ServerTimestamp)
    stamp = next((s for s in stamps if s is not None and s.year > _EPOCH.year), None)
    lost = status is not None and _overflowed(status.value)
    return Sample(tag, _nanoseconds(stamp), value, lost, first)


def _overflowed(status: int) -> bool:
    """Return whether a queue lost values before this one (OPC 10000-4, 7.39: info bits)."""
    data_value, overflow = 0x400, 0x80
    return status & 0xC00 == data_value and bool(status & overflow)


def _nanoseconds(stamp: datetime | None) -> int:
    if stamp is None:
        return 0
    plain = stamp.astimezone(timezone.utc).replace(tzinfo=None) if stamp.tzinfo else stamp
    since = plain - _EPOCH
    return ((since.days * 86400 + since.seconds) * 10**6 + since.microseconds) * _TICK_NS
