# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""More connections than a process has descriptors for: all is served again once they have gone."""

from __future__ import annotations

import os
import resource
import socket
import time
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("foxglove", reason="needs the extra gateway")
pytest.importorskip("websockets.sync.client", reason="needs the client websockets")

from foxglove import Context
from websockets.exceptions import WebSocketException

from test.gateway.foxglove.test_face import LIMIT_S, Server, Viewer
from test.gateway.test_web import store
from valve_twin.gateway.descriptors import MOST_DESCRIPTORS
from valve_twin.gateway.foxglove import listener as module
from valve_twin.gateway.foxglove.face import _Subscriptions
from valve_twin.gateway.foxglove.listener import Listener

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

VALVE = "/press/v"
TOLD = "too many connections: all clients were let go, it listens anew"


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    history = tmp_path / "history.sqlite"
    store(history, VALVE, range(1, 4), 0.0)
    made = Server(history)
    assert set(made.json()) == {VALVE}  # it has begun to serve
    yield made
    made.end()


def place(address: str) -> tuple[str, int]:
    host, port = address.split("//")[1].strip("/").split(":")
    return host, int(port)


def leave(pid: int, room: int) -> None:
    """Leave so many descriptors to a process."""
    held = max(map(int, os.listdir(f"/proc/{pid}/fd"))) + 1
    _, hard = resource.prlimit(pid, resource.RLIMIT_NOFILE)
    resource.prlimit(pid, resource.RLIMIT_NOFILE, (held + room, hard))


def look(server: Server) -> None:
    """See what is stored."""
    viewer = Viewer(server.address)
    viewer.look_at(f"{VALVE}/twin/estimate")
    viewer.until(lambda: len(viewer.of(f"{VALVE}/twin/estimate")) >= 3, "cycles")


def until_looked_at(server: Server) -> None:
    """Look as a client that tries again does."""
    end_s = time.monotonic() + LIMIT_S
    while True:
        try:
            look(server)
        except (OSError, EOFError, WebSocketException):
            assert time.monotonic() < end_s, server.said()
            time.sleep(0.1)  # polls
        else:
            return


def test_a_server_takes_the_descriptors_that_the_system_allows(server):
    soft, hard = resource.prlimit(server.process.pid, resource.RLIMIT_NOFILE)
    assert soft >= min(hard, MOST_DESCRIPTORS)


def test_foxglove_is_served_again_after_more_connections_than_descriptors(server):
    leave(server.process.pid, 20)
    where = place(server.address)
    with ExitStack() as stack:
        for _ in range(60):
            with suppress(OSError):
                stack.enter_context(socket.create_connection(where, timeout=LIMIT_S))
        end_s = time.monotonic() + LIMIT_S
        while TOLD not in server.said():  # as long as it has not taken them, none may leave
            assert time.monotonic() < end_s, server.said()
            time.sleep(0.05)  # polls
    until_looked_at(server)
    said = [line for line in server.said().splitlines() if "Foxglove at 127" in line]
    assert said == [f"Foxglove at 127.0.0.1:{where[1]}: {TOLD}"]


def test_who_floods_the_pages_takes_no_descriptor_from_foxglove(server):
    leave(server.process.pid, 20)
    page = place(server._found(r"http://127\.0\.0\.1:\d+"))
    before = server.said()
    with ExitStack() as stack:
        flood = [
            stack.enter_context(socket.create_connection(page, timeout=LIMIT_S)) for _ in range(60)
        ]
        assert flood[-1].recv(1) == b""  # let go at once
    until_looked_at(server)
    assert set(server.json()) == {VALVE}
    assert server.said().removeprefix(before).count("\n") <= 1


def test_another_process_that_takes_the_port_meanwhile_is_told_and_outlasted(caplog, monkeypatch):
    """It was taken for ourselves: nobody said that nothing was served."""
    monkeypatch.setattr(module, "EVERY_S", 0.0)
    listener = Listener(Context(), _Subscriptions(), "127.0.0.1", 0)
    where = place(listener.start())

    def gone() -> bool:
        listener.stop()
        while True:  # it lets go of its port a moment later
            with suppress(OSError):
                other.bind(where)
                other.listen()
                return False

    with socket.socket() as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        with monkeypatch.context() as harm:
            harm.setattr(listener, "_listens", gone)
            listener.look()
        for _ in range(3):
            listener.look()
    end_s = time.monotonic() + LIMIT_S
    while listener._server is None:
        assert time.monotonic() < end_s
        listener.look()
    assert listener._listens()
    listener.stop()
    own = [r.getMessage() for r in caplog.records if r.name == "valve_twin"]
    said = [text.split(": ", 1)[1] for text in own]
    assert [text.partition(":")[0] for text in said] == [
        "cannot listen",
        "listens again",
    ]
