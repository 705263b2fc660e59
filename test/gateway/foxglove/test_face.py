# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Foxglove's protocol as `valve-twin serve` speaks it, to a websocket client by others."""

from __future__ import annotations

import json
import re
import signal
import socket
import struct
import subprocess
import sys
import time
import urllib.request
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("foxglove", reason="needs the extra gateway")
pytest.importorskip("mcap_ros2", reason="needs the decoder mcap-ros2-support")
pytest.importorskip("websockets.sync.client", reason="needs the client websockets")

from mcap_ros2._dynamic import generate_dynamic
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from test.gateway.test_web import HOSTILE, store
from test.io.history.test_fleet import estimate
from valve_twin.cli import main
from valve_twin.core.aging.verdict import Verdict, VerdictKind
from valve_twin.gateway.foxglove import face as module
from valve_twin.gateway.foxglove.face import PAST, REST, FoxgloveFace
from valve_twin.gateway.view import View
from valve_twin.io.errors import StoreError
from valve_twin.io.history.fleet import FleetRow

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

LIMIT_S = 60.0
UNKNOWN = "Unknown channel ID: "
WORN, NEW = "/press/valve_1", "/press/new"
_HEAD = struct.Struct("<BIQ")


VIEWERS: list[Viewer] = []
"""All that are open."""


class Viewer:
    """Subscribes topics and decodes what comes by the definition that the server gives.

    foxglove-sdk 0.30 tells a client of a channel before it takes a subscription of it: who is
    quick is refused, and asks again.
    """

    def __init__(self, address: str) -> None:
        self.socket = connect(
            address,
            subprotocols=[Subprotocol("foxglove.sdk.v1")],
            max_size=None,
            ping_interval=None,  # no thread that complains when the server has gone
            close_timeout=0.2,  # behind messages that nobody read, the answer is not seen
        )
        VIEWERS.append(self)
        self.info = json.loads(self.socket.recv(LIMIT_S))
        self.channels: dict[str, dict[str, Any]] = {}
        self.heard: list[tuple[str, Any]] = []
        self._of: dict[int, tuple[str, Callable[[bytes], Any]]] = {}

    def step(self, timeout: float = LIMIT_S) -> None:
        got = self.socket.recv(timeout)
        if isinstance(got, bytes):
            kind, number, _ = _HEAD.unpack_from(got)
            assert kind == 1
            topic, decode = self._of[number]
            self.heard.append((topic, decode(got[_HEAD.size :])))
            return
        said = json.loads(got)
        if said["op"] == "advertise":
            self.channels |= {c["topic"]: c for c in said["channels"]}
        elif said["op"] == "unadvertise":
            gone = set(said["channelIds"])
            self.channels = {t: c for t, c in self.channels.items() if c["id"] not in gone}
        elif said["op"] == "status" and said["message"].startswith(UNKNOWN):
            channel = int(said["message"].removeprefix(UNKNOWN))
            self._ask({"id": 1000 + channel, "channelId": channel})

    def until(self, found: Callable[[], object], what: str) -> None:
        end = time.monotonic() + LIMIT_S
        while not found():
            assert time.monotonic() < end, (
                f"{what} within {LIMIT_S:g} s: {sorted({t for t, _ in self.heard})}"
            )
            try:
                self.step(0.2)
            except TimeoutError:
                continue

    def look_at(self, *topics: str) -> None:
        self.until(lambda: set(topics) <= set(self.channels), f"topics {topics}")
        asked = []
        for topic in topics:
            channel = self.channels[topic]
            assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
            decode = generate_dynamic(channel["schemaName"], channel["schema"])
            decoder = decode[channel["schemaName"]]
            number = 1000 + channel["id"]
            self._of[number] = topic, decoder
            asked.append({"id": number, "channelId": channel["id"]})
        self._ask(*asked)

    def _ask(self, *asked: dict[str, int]) -> None:
        self.socket.send(json.dumps({"op": "subscribe", "subscriptions": asked}))

    def of(self, topic: str) -> list[Any]:
        return [message for t, message in self.heard if t == topic]


class Server:
    """`valve-twin serve --foxglove`."""

    def __init__(self, history: Path, *more: str) -> None:
        command = [sys.executable, "-m", "valve_twin.cli", "serve", "--port", "0", *more]
        command += ["--url", f"sqlite:///{history}", "--foxglove", "0"]
        self._said = history.with_name(f"{time.monotonic_ns()}.log")
        with self._said.open("w") as stream:
            self.process = subprocess.Popen(command, stderr=stream, text=True)
        end = time.monotonic() + LIMIT_S
        while "http://" not in self.said():
            assert self.process.poll() is None, self.said()
            assert time.monotonic() < end
            time.sleep(0.05)  # polls
        self.address = self._found(r"ws://127\.0\.0\.1:\d+")

    def _found(self, pattern: str) -> str:
        found = re.search(pattern, self.said())
        assert found, self.said()
        return found.group()

    def said(self) -> str:
        return self._said.read_text()

    def json(self) -> dict[str, Any]:
        address = self._found(r"http://127\.0\.0\.1:\d+")
        with urllib.request.urlopen(f"{address}/api/valves", timeout=30) as answer:
            return {row["valve"]: row for row in json.load(answer)["valves"]}

    def end(self) -> None:
        self.process.send_signal(signal.SIGINT)
        try:
            assert self.process.wait(30) == 0
        finally:
            self.process.kill()
        assert "Traceback" not in self.said()
        assert "error of ours" not in self.said()


@pytest.fixture(autouse=True)
def no_viewer_stays() -> Iterator[None]:
    yield
    while VIEWERS:
        VIEWERS.pop().socket.close()


@pytest.fixture(scope="module")
def history(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("foxglove") / "history.sqlite"
    store(made, WORN, range(1, 61), -0.0045)
    store(made, NEW, range(1, 61), 0.0)
    store(made, HOSTILE, range(1, 3), 0.0)
    return made


@pytest.fixture(scope="module")
def server(history: Path) -> Iterator[Server]:
    made = Server(history)
    yield made
    made.end()


def has_heard(viewer: Viewer, topic: str, count: int) -> bool:
    return len(viewer.of(topic)) >= count


def test_who_looks_is_told_what_the_pages_show_and_what_comes_after(server, history):
    viewer = Viewer(server.address)
    assert viewer.info["capabilities"] == []  # it takes nothing
    trend, estimate = f"{WORN}/aging_monitor/trend/K_in", f"{WORN}/twin/estimate"
    verdict, diagnostics = f"{WORN}/aging_monitor/verdict", "/diagnostics"
    viewer.look_at(trend, estimate, verdict, diagnostics)
    viewer.until(lambda: len(viewer.of(estimate)) >= 60, "all stored cycles")
    viewer.until(lambda: viewer.of(trend) and viewer.of(verdict), "trend and verdict")
    viewer.until(lambda: viewer.of(diagnostics), "diagnostics")
    shown = server.json()[WORN]
    (level,) = (p for p in shown["parameters"] if p["parameter"] == "K_in")
    told = viewer.of(trend)[-1]
    assert (told.level, told.unit, told.valve) == (level["level"], level["unit"], WORN)
    assert told.drift_reference == shown["drift"]
    stamp = told.header.stamp
    assert stamp.sec * 10**9 + stamp.nanosec == shown["end_ns"]
    said = viewer.of(verdict)[-1]
    assert (said.text, said.evidence, said.cycle) == (shown["verdict"], shown["evidence"], 60)
    assert [e.cycle for e in viewer.of(estimate)] == list(range(1, 61))
    first = viewer.of(estimate)[0]
    assert first.names[0] == "K_in"
    assert first.values[0] == pytest.approx(0.01 * (1 - 0.0045 - 0.003), rel=1e-12)
    assert first.stored is True
    status = {s.name: s for s in viewer.of(diagnostics)[-1].status}
    assert set(status) == {"/serve: history", *(f"/serve: aging of {v}" for v in server.json())}
    assert status[f"/serve: aging of {WORN}"].level in (2, b"\x02")
    assert status[f"/serve: aging of {NEW}"].level in (0, b"\x00")

    store(history, WORN, range(61, 62), -0.0045)
    viewer.until(lambda: viewer.of(estimate)[-1].cycle == 61, "the new cycle")
    viewer.until(lambda: viewer.of(verdict)[-1].cycle == 61, "its verdict")
    assert [e.cycle for e in viewer.of(estimate)] == list(range(1, 62))


def test_the_shipped_layout_shows_topics_and_fields_that_are_served(server, root):
    layout = json.loads((root / "layouts" / "foxglove.json").read_text(encoding="utf-8"))
    viewer = Viewer(server.address)
    viewer.until(lambda: f"{WORN}/twin/estimate" in viewer.channels, "topics")
    panels = layout["configById"].values()
    asked = {p["value"].rpartition(".")[::2] for panel in panels for p in panel.get("paths", ())}
    of_samples = {f"{WORN}/twin/prediction", *(t for t, _ in asked if "/command/" in t)}
    stored = {topic for topic, _ in asked} - of_samples
    assert len(stored) > 4
    viewer.look_at(*stored)
    viewer.until(lambda: stored == {t for t, _ in viewer.heard}, "a message of each")
    for topic, name in asked:
        if topic in stored:
            assert isinstance(getattr(viewer.of(topic)[-1], name), int | float), (topic, name)
    assert layout["configById"]["DiagnosticSummary!all"]["topicToRender"] in viewer.channels


def test_a_hostile_name_is_a_topic_like_another(server):
    viewer = Viewer(server.address)
    topic = f"{HOSTILE}/twin/estimate"
    viewer.look_at(topic)
    viewer.until(lambda: len(viewer.of(topic)) == 2, "its cycles")
    assert {e.valve for e in viewer.of(topic)} == {HOSTILE}


def test_who_comes_later_is_told_all_as_well(server):
    topic = f"{NEW}/twin/estimate"
    for viewer in (Viewer(server.address), Viewer(server.address)):
        viewer.look_at(topic)
        viewer.until(partial(has_heard, viewer, topic, 60), "all stored cycles")


def test_of_a_long_history_the_newest_cycles_are_told(tmp_path):
    history = tmp_path / "history.sqlite"
    store(history, "/v", range(1, PAST + 101), 0.0)
    server = Server(history)
    viewer = Viewer(server.address)
    viewer.look_at("/v/twin/estimate")
    viewer.until(lambda: len(viewer.of("/v/twin/estimate")) >= PAST, "cycles")
    found = [e.cycle for e in viewer.of("/v/twin/estimate")]
    assert found == list(range(101, PAST + 101))
    server.end()


def test_what_clients_send_changes_nothing_and_stops_nobody(server, history):
    before = history.read_bytes()
    rude = Viewer(server.address)
    rude.until(lambda: f"{WORN}/twin/estimate" in rude.channels, "topics")
    number = rude.channels[f"{WORN}/twin/estimate"]["id"]
    advertised = {"id": 1, "topic": f"{WORN}/command/v_in", "encoding": "json", "schemaName": "x"}
    asked = [{"id": k, "channelId": number} for k in range(2000)]  # and never reads
    for said in (
        "{",
        '{"op": "none"}',
        '{"op": "setParameters", "parameters": [{"name": "a", "value": 1}]}',
        json.dumps({"op": "advertise", "channels": [advertised]}),
        b"\x01\x01\x00\x00\x00{}",
        b"",
        json.dumps({"op": "subscribe", "subscriptions": asked}),
    ):
        try:
            rude.socket.send(said)
        except ConnectionClosed:
            break
    viewer = Viewer(server.address)
    viewer.look_at(f"{NEW}/twin/estimate")
    viewer.until(lambda: len(viewer.of(f"{NEW}/twin/estimate")) >= 60, "cycles")
    assert f"{WORN}/command/v_in" not in viewer.channels
    assert history.read_bytes() == before


def test_what_clients_do_wrong_fills_no_log(server):
    """A client that asks for what is not there wrote a line for each try: 290 000 in 30 s."""
    before = server.said()
    rude = Viewer(server.address)
    asked = [{"id": k, "channelId": 1_000_000 + k} for k in range(1000)]
    rude.socket.send(json.dumps({"op": "subscribe", "subscriptions": asked}))
    rude.socket.send('{"op": "none"}')
    place = re.sub(r".*//", "", server.address).split(":")
    with socket.create_connection((place[0], int(place[1]))) as stranger:
        stranger.sendall(b"no request\r\n\r\n")
    viewer = Viewer(server.address)
    viewer.look_at(f"{NEW}/twin/estimate")
    viewer.until(partial(has_heard, viewer, f"{NEW}/twin/estimate", 60), "cycles")
    said: list[str] = []
    while not any('"op":"status"' in text.replace(" ", "") and "none" in text for text in said):
        said.append(str(rude.socket.recv(LIMIT_S)))  # by then it has read all
    assert server.said() == before


def test_a_history_that_is_gone_shows_as_stale(tmp_path):
    history = tmp_path / "history.sqlite"
    store(history, "/v", range(1, 4), 0.0)
    server = Server(history)
    viewer = Viewer(server.address)
    viewer.look_at("/diagnostics")

    def condition() -> Any:
        found = viewer.of("/diagnostics")
        return {s.name: s for s in found[-1].status}["/serve: history"] if found else None

    viewer.until(condition, "diagnostics")
    assert condition().level in (0, b"\x00")
    history.unlink()
    viewer.until(lambda: condition().level in (3, b"\x03"), "the trouble")
    assert "history.sqlite" in condition().message
    server.end()


def test_estimates_that_cannot_be_read_keep_nothing_else_back(monkeypatch, caplog):
    """Who asked for them had no diagnostics any more, and nothing of the valves behind."""
    asked, fails = list[str](), True
    monkeypatch.setattr(module, "PERIOD_S", 0.2)
    rows = tuple(FleetRow(v, "press_cartridge", cycle=3) for v in ("/a", "/b"))
    verdict = Verdict(3, "/b", VerdictKind.OK, "ok", "", 3)

    def view() -> View:
        if len(asked) == 1:
            asked.append("an error of ours")
            raise ValueError(asked[-1])
        return View(rows, verdicts={"/b": verdict}, failure="gone" if fails else "")

    def estimates(valve: str, first: int, limit: int) -> list[Any]:
        asked.append(valve)
        if fails:
            raise StoreError(valve)
        return [replace(estimate(3, {"K_in": 0.01}), cycle=3)]

    face = FoxgloveFace(view, estimates, "127.0.0.1", 0)
    try:
        viewer = Viewer(face.start())
        viewer.look_at("/diagnostics", "/a/twin/estimate", "/b/aging_monitor/verdict")
        viewer.until(lambda: viewer.of("/b/aging_monitor/verdict"), "a verdict")
        viewer.until(lambda: len(viewer.of("/diagnostics")) > 3, "diagnostics")
        assert {s.level for s in viewer.of("/diagnostics")[-1].status} <= {3, b"\x03"}
        assert len(asked) < 30
        assert not viewer.of("/a/twin/estimate")
        fails = False
        viewer.until(lambda: viewer.of("/a/twin/estimate"), "what is owed")
    finally:
        face.stop()
    assert [r.getMessage() for r in caplog.records if r.name == "valve_twin"] == [
        "Foxglove: an error of ours"
    ]


def test_a_port_that_is_taken_or_none_is_told_in_one_line(history, capsys):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        given = ["serve", "--port", "0", "--url", str(history), "--foxglove"]
        assert main([*given, str(port)]) != 0
        (line,) = capsys.readouterr().err.splitlines()
        assert f"Foxglove: cannot listen at 127.0.0.1:{port}" in line
        assert main([*given, "70000"]) != 0
        (line,) = capsys.readouterr().err.splitlines()
        assert "port 70000 is not in 0 .. 65535" in line


def test_clients_that_subscribe_again_and_again_take_a_share_of_a_core(monkeypatch):
    monkeypatch.setattr(module, "PAUSE_S", 0.0)
    face = FoxgloveFace(View, lambda *_: [], "127.0.0.1", 0)
    monkeypatch.setattr(face._subscriptions, "take", lambda: {"/v/twin/estimate"})
    spent: list[float] = []

    def step(*_: object, **__: object) -> None:
        begun = time.thread_time()
        while time.thread_time() - begun < 0.02:
            pass
        spent.append(time.thread_time() - begun)
        if len(spent) == 10:
            face._end.set()

    monkeypatch.setattr(face, "_step", step)
    begun = time.monotonic()
    face._run()
    assert sum(spent[:-1]) <= 1.05 / REST * (time.monotonic() - begun)
