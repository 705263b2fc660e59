# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Hostile clients of Foxglove at the node: who looks on beside them sees all that is live."""

from __future__ import annotations

import json
import re
import socket
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest

pytest.importorskip("foxglove", reason="needs the extra gateway")
pytest.importorskip("websockets.sync.client", reason="needs the client websockets")
pytest.importorskip("mcap_ros2", reason="needs the decoder mcap-ros2-support")

from websockets.exceptions import WebSocketException

from test.gateway.foxglove.test_face import VIEWERS, Viewer
from test.gateway.foxglove.test_listener import leave, place
from test.gateway.test_web import store
from test.nodes.conftest import NS
from test.nodes.gateway.test_node import FakeTwin

MORE_MB = 150.0
PREDICTION, COMMAND = f"{NS}/twin/prediction", f"{NS}/command/v_in"
HARM = (
    "{",
    '{"op": "none"}',
    '{"op": "subscribe"}',
    '{"op": "subscribe", "subscriptions": [{"id": -1, "channelId": 1e99}]}',
    '{"op": "unsubscribe", "subscriptionIds": [0, 1, 4294967295]}',
    '{"op": "setParameters", "parameters": [{"name": "history_url", "value": "sqlite:////x"}]}',
    '{"op": "getParameters", "parameterNames": []}',
    '{"op": "fetchAsset", "uri": "file:///etc/passwd", "requestId": 1}',
    '{"op": "subscribeConnectionGraph"}',
    json.dumps({"op": "advertise", "channels": [{"id": 1, "topic": COMMAND, "encoding": "cdr",
                "schemaName": "valve_twin_msgs/msg/Float64Stamped"}]}),
    b"\x01\x01\x00\x00\x00" + bytes(60),
    b"\x02" * 1000,
    b"",
    "[" * 50_000,
    "x" * 3_000_000,
)  # fmt: skip


@pytest.fixture
def gateway(graph, tmp_path):
    path = tmp_path / "history.sqlite"
    store(path, NS, range(1, 4), 0.0)
    made = graph.start("gateway", port=0, foxglove=0, history_url=f"sqlite:///{path}")
    found = graph.spin_until(lambda: re.search(r"ws://\S+", made.log), what="Foxglove")
    twin = FakeTwin(graph.domain)
    yield found.group(), made
    twin.kill()
    while VIEWERS:
        VIEWERS.pop().socket.close()


def memory_mb(pid: int) -> float:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * 4096e-6


def look(address: str) -> Viewer:
    """Look at a live topic until ten messages of it came."""
    viewer = Viewer(address)
    viewer.look_at(PREDICTION)
    viewer.until(lambda: len(viewer.of(PREDICTION)) > 10, "predictions")
    return viewer


def test_who_looks_sees_all_beside_clients_that_lie_flood_or_never_read(graph, gateway):
    address, made = gateway
    good = look(address)
    before_mb = memory_mb(made.pid)
    number = good.channels[PREDICTION]["id"]
    said = made.log
    for harm in HARM:
        rude = Viewer(address)
        with suppress(WebSocketException):  # let go
            rude.socket.send(harm)
    deaf = Viewer(address)
    asked = [{"id": k, "channelId": number} for k in range(2000)]
    deaf.socket.send(json.dumps({"op": "subscribe", "subscriptions": asked}))
    fickle = Viewer(address)
    for k in range(500):
        one = [{"id": k, "channelId": number}]
        fickle.socket.send(json.dumps({"op": "subscribe", "subscriptions": one}))
        fickle.socket.send(json.dumps({"op": "unsubscribe", "subscriptionIds": [k]}))
    good.heard.clear()
    good.until(lambda: len(good.of(PREDICTION)) > 400, "what is live")
    look(address)
    assert COMMAND not in graph_publishers(graph, "gateway")
    assert memory_mb(made.pid) < before_mb + MORE_MB
    assert made.log == said


def graph_publishers(graph, name: str) -> set[str]:
    """Return the topics that a node of the valve publishes."""
    return {t for t, _ in graph.node.get_publisher_names_and_types_by_node(name, NS)}


def test_more_connections_than_descriptors_do_not_end_what_is_live(graph, gateway):
    address, made = gateway
    look(address)
    leave(made.pid, 20)
    with ExitStack() as stack, suppress(OSError):
        for _ in range(60):
            stack.enter_context(socket.create_connection(place(address), timeout=5.0))

    def seen() -> Viewer | None:
        with suppress(OSError, EOFError, WebSocketException):  # let go before it had all
            return look(address)
        return None

    graph.spin_until(seen, what="a viewer that tries again")
    graph.wait_log(made, "too many connections: all clients were let go")
    assert "Traceback" not in made.log
    assert made.process.poll() is None
