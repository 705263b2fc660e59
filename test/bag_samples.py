# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Samples and texts of a test's bag, one by one."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

from valve_twin.io.bags.contents import channel_types, open_file, topic_name
from valve_twin.io.bags.folder import bag_files
from valve_twin.io.cdr.codec import encode_stamped
from valve_twin.io.cdr.signals import STAMPED_TYPE
from valve_twin.io.mcap.reader import messages

if TYPE_CHECKING:
    from pathlib import Path

    from valve_twin.io.bags.writer import BagWriter


def write_sample(
    bag: BagWriter, topic: str, stamp_ns: int, value: float, *, log_ns: int | None = None
) -> None:
    """Append a Float64Stamped to a topic, added where it is not known."""
    bag.add_topic(topic, STAMPED_TYPE)
    at = stamp_ns if log_ns is None else log_ns
    bag.write(topic, encode_stamped(stamp_ns, value), log_ns=at, publish_ns=stamp_ns)


def read_texts(path: str | Path, topic: str) -> list[tuple[int, str]]:
    """Return log times [ns] and texts of a std_msgs/msg/String topic; empty if it is not there."""
    found: list[tuple[int, str]] = []
    names, _ = bag_files(path)
    with ExitStack() as stack:
        for name in names:
            file = open_file(name, stack)
            for channel in file.summary.channels.values():
                if topic_name(channel.topic) != topic:
                    continue
                types = channel_types(file, channel)
                for chunk in file.summary.chunks:
                    for message in messages(file.chunk(chunk), {channel.id}):
                        decoded = types.decode(message.data, message.log_ns)
                        found.append((message.log_ns, str(decoded.data)))
    return sorted(found)
