# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Tell the subscriptions of this process that numbers of a publisher will not come.

Fast DDS drops a message of 0 bytes where it arrives, marks nothing, and a reliable reader waits
for that number for ever. What follows has arrived and lies in the reader's own history, held back
for the sake of the order: a reader that is made anew loses it. What a publisher says of a number
that is of no use to a reader is GAP, one submessage of RTPS. The publisher here does not say it,
so this process says it to itself, over the loopback, in the publisher's name: what lies there is
handed on at once, nothing is lost. A number that has arrived is not touched by a GAP, only what is
missing is given up.

It takes Fast DDS, a port of UDP, and no security, under which nobody can speak for another.
"""

from __future__ import annotations

import os
import re
import socket
import struct
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from rclpy.utilities import get_rmw_implementation_identifier

from valve_twin.nodes.runtime.transport.dead_ports import domain_ports

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from rclpy.node import Node

_HEADER = b"RTPS" + bytes([2, 3, 1, 15])
"""Version of the protocol and the vendor, whose details these are."""

_GAP, _LITTLE_ENDIAN = 0x08, 1
_PREFIX, _GUID = 12, 16
"""Bytes of a participant's name, and of it with the entity's behind."""

MOST = 1_000_000
"""Numbers that are passed over at once: the middleware looks at each [1]."""


def pass_over_missing(
    node: Node, topic: str, kind: str, heard: Mapping[str, int], newest: Mapping[str, int]
) -> bool:
    """Give up what the only publisher of a topic sent and a subscription of a node did not get.

    Parameters
    ----------
    node : Node
        Whose subscription waits.
    topic, kind : str
        Topic and message type.
    heard, newest : mapping
        What the middleware said of the last message that the subscription handed on, empty where
        there is none, and of the last one that another one got.

    Returns
    -------
    bool
        False where this process cannot be told, or whose message is missing is not known.
    """
    offers = [p for p in node.get_publishers_info_by_topic(topic) if p.topic_type == kind]
    if len(offers) != 1 or not heard:
        return False
    first, last = (int(i["publication_sequence_number"]) for i in (heard, newest))
    domain = int(node.context.get_domain_id())
    return pass_over(offers[0].endpoint_gid, first + 1, last, domain)


def pass_over(publisher: Iterable[int], first: int, last: int, domain: int) -> bool:
    """Say that what is missing of a publisher's messages will not come.

    Parameters
    ----------
    publisher : iterable of int
        Its GUID, as the graph tells it.
    first, last : int
        Numbers of messages, both included; those that have arrived are heard [1].
    domain : int
        ROS domain [1].

    Returns
    -------
    bool
        False where this process cannot be told: another middleware, security, no port of UDP, or
        one that takes nothing now.
    """
    if os.environ.get("ROS_SECURITY_ENABLE", "").lower() == "true":
        return False
    if not get_rmw_implementation_identifier().startswith("rmw_fastrtps"):
        return False
    ports = own_ports(domain)
    if not ports or not 0 < first <= last < first + MOST:
        return False
    text, said = gap(bytes(publisher), first, last), False
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for port in ports:
            with suppress(OSError):  # a full buffer
                said = out.sendto(text, ("127.0.0.1", port)) > 0 or said
    return said


def gap(publisher: bytes, first: int, last: int) -> bytes:
    """Return the message of RTPS that says so to every reader of who gets it.

    Parameters
    ----------
    publisher : bytes
        Its GUID.
    first, last : int
        Numbers of messages, both included [1].
    """
    participant, entity = publisher[:_PREFIX], publisher[_PREFIX:_GUID]
    body = bytes(4) + entity + _number(first) + _number(last + 1) + struct.pack("<I", 0)
    submessage = struct.pack("<BBH", _GAP, _LITTLE_ENDIAN, len(body)) + body
    return _HEADER + participant + submessage


def _number(sequence: int) -> bytes:
    return struct.pack("<iI", sequence >> 32, sequence & 0xFFFFFFFF)


def own_ports(domain: int, process: Path = Path("/proc/self")) -> list[int]:
    """Return the ports of UDP on which this process listens in a domain.

    Parameters
    ----------
    domain : int
        ROS domain [1].
    process : Path
        Where the kernel shows this process.
    """
    inodes = set()
    with suppress(OSError):
        for descriptor in (process / "fd").iterdir():
            with suppress(OSError):  # it has just been closed
                inodes.add(re.sub(r"^socket:\[(\d+)\]$", r"\1", str(descriptor.readlink())))
        lines = [x.split() for x in (process / "net" / "udp").read_text().splitlines()[1:]]
        found = {int(f[1].rpartition(":")[2], 16) for f in lines if f[9] in inodes}
        return sorted(found & set(domain_ports(domain)))
    return []
