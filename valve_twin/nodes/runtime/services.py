# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Services whose answer comes later, so that a database does not stall the loop.

rclpy's events executor knows no coroutine services; here the answer is sent when it is there, with
any executor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from valve_twin.nodes.runtime.compat import intercept_responses

if TYPE_CHECKING:
    from rclpy.node import Node

Done = Callable[[Any], None]
Begin = Callable[[Any, Any, Done], None]


@dataclass(slots=True)
class _Pending:
    response: Any
    header: Any = None
    done: bool = False


class DeferredService:
    """Service that answers when `done(response)` is called on the node's thread, now or later.

    Parameters
    ----------
    node : Node
        Where the service lives.
    kind : type
        Service type.
    name : str
        Service name.
    begin : callable
        Gets request, an empty response and `done`; must see to it that `done` is called once.
    """

    def __init__(self, node: Node, kind: Any, name: str, begin: Begin) -> None:
        self._node = node
        self._begin = begin
        self._service = node.create_service(kind, name, self._on_request)
        self._send = intercept_responses(self._service, self._on_response)

    def destroy(self) -> None:
        """Take the service down; answers still due are not sent."""
        self._node.destroy_service(self._service)

    def _on_request(self, request: Any, response: Any) -> _Pending:
        pending = _Pending(response)
        try:
            self._begin(request, response, partial(self._finish, pending))
        except Exception as err:
            response.success = False
            response.message = f"{type(err).__name__}: {err}"
            self._finish(pending, response)
        return pending

    def _on_response(self, pending: _Pending, header: Any) -> None:
        pending.header = header
        if pending.done:
            self._send(pending.response, header)

    def _finish(self, pending: _Pending, response: Any) -> None:
        pending.response, pending.done = response, True
        if pending.header is not None:
            self._send(response, pending.header)
