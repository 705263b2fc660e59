# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Services that nodes share, and those whose answer comes later: a database stalls no loop.

rclpy's events executor knows no coroutine services; here the answer is sent when it is there, with
any executor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from valve_twin_msgs import srv

from valve_twin.compat.ros import intercept_responses

if TYPE_CHECKING:
    from rclpy.node import Node

Done = Callable[[Any], None]
Begin = Callable[[Any, Any, Done], None]


def create_pause_services(
    node: Node, is_paused: Callable[[], bool], pause: Callable[[bool], object]
) -> None:
    """Offer ~/pause, ~/resume, ~/toggle_paused and ~/is_paused, as rosbag2 does.

    Parameters
    ----------
    node : Node
        Whose services they are.
    is_paused : callable
        Says whether the node pauses.
    pause : callable
        Gets whether it is to pause.
    """

    def answer(change: Callable[[], object], request: Any, response: Any) -> Any:
        del request
        change()
        return response

    def say(request: Any, response: Any) -> Any:
        del request
        response.paused = is_paused()
        return response

    for kind, name, change in (
        (srv.Pause, "pause", lambda: pause(True)),
        (srv.Resume, "resume", lambda: pause(False)),
        (srv.TogglePaused, "toggle_paused", lambda: pause(not is_paused())),
    ):
        node.create_service(kind, f"~/{name}", partial(answer, change))
    node.create_service(srv.IsPaused, "~/is_paused", say)


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
