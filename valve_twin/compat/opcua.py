# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What asyncua keeps private."""

from __future__ import annotations

import math
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, MutableMapping, MutableSequence

MOST_ELEMENTS = 200_000
"""Elements of all arrays of a message of OPC UA: twice what ten full queues send at once [1]."""


def policies_of(server: Any) -> MutableSequence[Any]:
    """Return the security policies that an OPC UA server offers, to add one with its own rules.

    asyncua knows one set of permissions for all that `set_security_policy` names; no issue is
    known. Goes when it takes one a policy.
    """
    policies: MutableSequence[Any] = server._policies
    return policies


def nodes_of(server: Any) -> MutableMapping[Any, Any]:
    """Return the nodes of the inner part of an OPC UA server by their ids.

    asyncua writes them all to one file and reads them all, which takes half as long as making
    them, or to a shelf that lists only those that were used; no issue is known. Goes when it can
    be given a mapping.
    """
    nodes: MutableMapping[Any, Any] = server.aspace._nodes
    return nodes


def set_nodes(server: Any, nodes: MutableMapping[Any, Any]) -> None:
    """Give the inner part of an OPC UA server its nodes, as `nodes_of` returns them."""
    server.aspace._nodes = nodes


def sessions_of(server: Any) -> dict[Any, Any]:
    """Return the sessions that clients opened at an OPC UA server, by their tokens.

    asyncua keeps any number that is made and never used, and shows none; no issue is known. Goes
    when the server takes a greatest number.
    """
    sessions: dict[Any, Any] = server.iserver._external_sessions
    return sessions


def publishing_of(client: Any) -> Any:
    """Return the task by which an OPC UA client asks for what is published, None where none does.

    asyncua lets it end without a word where the server ends the subscription; no issue is known.
    Goes when it tells.
    """
    return client.uaclient._publish_task


def subscribing_of(subscription: Any) -> Any:
    """Return what adds nodes to an OPC UA subscription under a filter.

    asyncua's `subscribe_data_change` does the same without one; no issue is known. Goes when it
    takes a filter.
    """
    return subscription._subscribe


def bound_arrays(most: int = MOST_ELEMENTS) -> None:
    """Let the arrays of a message of OPC UA hold so many elements together, and none more than it.

    asyncua makes the list that four bytes of a message claim before it looks at what follows, and
    elements of the type Null take none: 9 bytes took 16 GB. Dimensions beyond the elements it
    fills with empty lists, a million for each value. No issue is known. Goes when it has a limit.
    """
    codec: Any = import_module("asyncua.ua.ua_binary")
    if getattr(codec._reshape, "most", None) == most:
        return  # a client that connects again keeps what is made of the types
    message, spent = b"", 0

    def spend(data: Any) -> None:
        nonlocal message, spent
        if data._data is not message:
            message, spent = data._data, 0
        elements = codec.Primitives.Int32.unpack(data.copy(4))
        spent += max(elements, 0)
        if elements > len(data) or spent > most:
            msg = f"an array of {elements} elements in a message of {len(message)} bytes"
            raise codec.UaError(msg)

    def bounded(make: Any) -> Any:
        def made(*kind: Any) -> Any:
            read = make(*kind)

            def deserialize(data: Any) -> Any:
                if isinstance(data, codec.Buffer):
                    spend(data)
                return read(data)

            return deserialize

        made.unbounded = make  # type: ignore[attr-defined]
        return cache(made)

    shape = getattr(codec._reshape, "unbounded", codec._reshape)

    def reshape(flat: list[Any], dimensions: list[int]) -> list[Any]:
        if 0 in dimensions and not flat:
            return flat
        made = len(dimensions) * len(flat)  # lists within lists, at most
        if min(dimensions) < 1 or math.prod(dimensions) > len(flat) or made > most:
            msg = f"an array of {len(flat)} elements with dimensions {str(dimensions)[:80]}"
            raise codec.UaError(msg)
        shaped: list[Any] = shape(flat, dimensions)
        return shaped

    reshape.unbounded, reshape.most = shape, most  # type: ignore[attr-defined]
    codec._reshape = reshape
    for name in ("_create_uatype_array_deserializer", "_create_list_deserializer"):
        make = getattr(codec, name)
        setattr(codec, name, bounded(getattr(make, "unbounded", make)))
    codec._create_type_deserializer.cache_clear()
    codec._create_dataclass_deserializer.cache_clear()


def bound_messages(client: Any, most: int, tell: Callable[[str], None]) -> None:
    """Let an OPC UA client keep so much of a message of its server, and end where that is more.

    asyncua waits for what a header says, up to 4 GB, and for parts of a message as long as they
    come; a server sets the limits of its client. No issue is known. Goes when a client has limits
    of its own.

    Parameters
    ----------
    client : asyncua.Client
        Not connected yet.
    most : int
        Bytes of a message; a part of it has as many as the client asks for, 64 kB.
    tell : callable
        Gets one line where a connection ends for it.
    """
    make = client.uaclient._make_protocol

    def bounded() -> Any:
        protocol = make()
        limits, receive = protocol._connection._limits, protocol.data_received
        grant, part = limits.update_client_limits, limits.max_recv_buffer

        def granted(message: Any) -> None:
            grant(message)
            limits.max_recv_buffer = part  # as asked for; asyncua takes what the server receives
            limits.max_message_size = min(limits.max_message_size or most, most)

        def received(data: bytes) -> None:
            receive(data)
            if len(protocol.receive_buffer or b"") > most and protocol.transport is not None:
                tell(f"the server sends a message of more than {most} bytes")
                protocol.receive_buffer = None
                protocol.transport.abort()

        limits.max_message_size = most
        limits.update_client_limits, protocol.data_received = granted, received
        return protocol

    client.uaclient._make_protocol = bounded
