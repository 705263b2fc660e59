# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The faces as node and `serve` open them: a history that takes long to be read delays none."""

from __future__ import annotations

import asyncio
import json
import logging
import shutil
import sqlite3
import threading
import time
from contextlib import closing
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("asyncua", reason="needs the extra gateway")
pytest.importorskip("foxglove", reason="needs the extra gateway")
pytest.importorskip("pysparkplug", reason="needs the extra gateway")

from asyncua import Client, ua

from test.gateway.mqtt.brokers import GROUP, NODE, Listener, Mosquitto
from test.gateway.test_web import Server, store
from test.io.history.test_fleet import estimate, record
from test.small_disk import small_disk
from valve_twin.gateway import faces as faces_module
from valve_twin.gateway.faces import faces
from valve_twin.gateway.mqtt.backlog import Backlog
from valve_twin.gateway.opcua.server import OpcUaFace
from valve_twin.gateway.plant import Plant
from valve_twin.io.config.gateway_parameters import FaceParameters
from valve_twin.io.history.store import History

if TYPE_CHECKING:
    from pathlib import Path

LIMIT_S = 60.0


@pytest.fixture
def slow_plant(tmp_path, monkeypatch):
    """A plant of two valves whose first reading goes on only when it may."""
    path, go_on, state = tmp_path / "history.sqlite", threading.Event(), Plant._state
    for valve in ("/a", "/b"):
        store(path, valve, range(1, 4), 0.0)

    def slow(plant: Plant, history, valve: str, mark):
        assert go_on.wait(LIMIT_S)
        return state(plant, history, valve, mark)

    monkeypatch.setattr(Plant, "_state", slow)
    yield Plant(f"sqlite:///{path}"), go_on
    go_on.set()


def until(found, what: str) -> None:
    end = time.monotonic() + LIMIT_S
    while not found():
        assert time.monotonic() < end, what
        time.sleep(0.01)  # polls


def test_no_face_waits_for_the_first_reading_and_each_shows_the_valves_after_it(
    slow_plant, tmp_path, monkeypatch
):
    plant, go_on = slow_plant
    shown: dict[str, OpcUaFace] = {}
    start = OpcUaFace.start

    def noted(face: OpcUaFace) -> str:
        shown["opcua"] = face
        return start(face)

    monkeypatch.setattr(OpcUaFace, "start", noted)
    given = FaceParameters(
        opcua="opc.tcp://127.0.0.1:0", opcua_pki=str(tmp_path), opcua_anonymous=True, foxglove=0
    )
    level = logging.getLogger("asyncua").level
    try:
        with faces(plant, given, lambda _: None) as opened:
            foxglove = opened.foxglove
            assert foxglove is not None
            assert not plant.news().whole  # open, and nothing is read
            assert set(foxglove._channels) == {"/diagnostics"}
            assert shown["opcua"]._valves == {}
            go_on.set()
            until(lambda: set(shown["opcua"]._valves) == {"/a", "/b"}, "OPC UA")
            until(lambda: "/b/twin/estimate" in foxglove._channels, "Foxglove")
    finally:
        logging.getLogger("asyncua").setLevel(level)


def test_faces_whose_disk_is_read_only_are_said_once_and_opened_later_while_the_others_go_on(
    tmp_path, monkeypatch
):
    """`serve` ended with 1, the node kept its pages back; each now waits in the same way."""
    monkeypatch.setattr(faces_module, "RETRY_S", 0.01)
    path = tmp_path / "history.sqlite"
    store(path, "/a", range(1, 4), 0.0)
    told: list[str] = []
    with small_disk(tmp_path / "disk", "1m") as disk:
        disk.mount("remount,ro")
        given = FaceParameters(
            opcua="opc.tcp://127.0.0.1:0",
            opcua_pki=str(disk.place / "pki"),
            opcua_anonymous=True,
            mqtt="mqtt://127.0.0.1:1",
            mqtt_state=str(disk.place / "marks" / "state"),
            foxglove=0,
        )
        with faces(Plant(f"sqlite:///{path}"), given, told.append) as opened:
            assert opened.foxglove is not None
            assert opened.closed == tuple(told[:2])
            assert [t.partition(": ")[0] for t in told[:2]] == [
                str(disk.place / "pki"),
                str(disk.place / "marks" / "state"),
            ]
            assert all("Read-only file system: make the disk writable again; it is" in t
                       for t in told[:2])  # fmt: skip
            assert told[2].startswith("Foxglove at")
            disk.mount("remount,rw")
            until(lambda: len(told) == 5, "the two others")
            until((disk.place / "marks" / "state").exists, "the marks")
            assert opened.closed == ()
        assert {t.split(" ")[0] for t in told[3:]} == {"OPC", "MQTT"}
        again = Backlog(disk.place / "marks" / "state", lambda *_: [], read_of(disk.place))
        again.close()  # nobody holds it any more


def read_of(folder: Path) -> str:
    """Return whose marks lie in a folder."""
    found: str = json.loads((folder / "marks" / "state").read_text())["of"]
    return found


def test_a_face_that_waits_for_its_disk_ends_with_the_others(tmp_path, monkeypatch):
    monkeypatch.setattr(faces_module, "RETRY_S", 600.0)
    path = tmp_path / "history.sqlite"
    store(path, "/a", range(1, 4), 0.0)
    told: list[str] = []
    with small_disk(tmp_path / "disk", "1m") as disk:
        disk.mount("remount,ro")
        state = str(disk.place / "state")
        given = FaceParameters(mqtt="mqtt://127.0.0.1:1", mqtt_state=state)
        with faces(Plant(f"sqlite:///{path}"), given, told.append):
            assert len(told) == 1
            waiting = [t for t in threading.enumerate() if t.name == "disk"]
            assert len(waiting) == 1
            begun_s = time.monotonic()
        assert time.monotonic() - begun_s < 60.0
        assert not waiting[0].is_alive()


def test_serve_shows_its_pages_while_the_disk_of_its_marks_is_read_only(tmp_path):
    path = tmp_path / "history.sqlite"
    store(path, "/a", range(1, 4), 0.0)
    with small_disk(tmp_path / "disk", "1m") as disk:
        disk.mount("remount,ro")
        state = disk.place / "state"
        server = Server(path, "--mqtt", "mqtt://127.0.0.1:1", "--mqtt-state", str(state))
        try:
            assert json.loads(server.get("/api/valves")[1])["valves"][0]["cycle"] == 3
            assert f"{state}: cannot be written: Read-only file system" in server.begun
            disk.mount("remount,rw")
            until(state.exists, "the marks")
        finally:
            assert server.end() == 0
    assert server.begun.count("cannot be written") == 1


def store_later(path: Path, cycles: range) -> None:
    """Store cycles that were made an hour behind those that `store` stores."""
    values = {"K_in": 0.01, "K_out": 0.045, "leak": 1e-3}
    with History(path) as history:
        for cycle in cycles:
            last, found = record(cycle), estimate(cycle, values)
            end_ns = last.end_ns + 3600 * 10**9
            history.store("/v", replace(last, end_ns=end_ns), (replace(found, end_ns=end_ns),))


async def opcua_says(address: str) -> tuple[int, str, str, bool]:
    """Return cycle, its status, the failure and whether the history can be read."""
    async with Client(address) as client:
        own = await client.get_namespace_index("urn:valve_twin:valves")
        cycle = await client.get_node(ua.NodeId("/v#Cycle", own)).read_data_value(False)
        failure = await client.get_node(ua.NodeId("History#Failure", own)).read_value()
        readable = await client.get_node(ua.NodeId("History#Readable", own)).read_value()
        return cycle.Value.Value, cycle.StatusCode.name, failure, readable


def test_every_face_says_that_a_history_is_gone_and_loses_nothing_of_the_backup_in_its_place(
    tmp_path,
):
    """A process as a user starts it; the backup is far behind and the twin has gone on since."""
    path, backup = tmp_path / "history.sqlite", tmp_path / "backup.sqlite"
    files = [path, path.with_name("history.sqlite-wal"), path.with_name("history.sqlite-shm")]
    store(path, "/v", range(1, 6), 0.0)
    with closing(sqlite3.connect(path)) as own, closing(sqlite3.connect(backup)) as copy:
        own.backup(copy)
    store(path, "/v", range(6, 9), 0.0)
    broker = Mosquitto(tmp_path)
    listener = Listener(broker)
    mqtt = ("--mqtt", broker.address, "--mqtt-group", GROUP, "--mqtt-node", NODE)
    opcua = ("--opcua", "opc.tcp://127.0.0.1:0", "--anonymous", "--opcua-pki", str(tmp_path))
    server = Server(path, *mqtt, "--mqtt-state", str(tmp_path / "state"), *opcua)
    (address,) = [word for word in server.begun.split() if word.startswith("opc.tcp")]
    try:
        until(lambda: listener.of("DBIRTH", "v"), "a birth")
        store(path, "/v", range(9, 11), 0.0)
        until(lambda: (10, False) in listener.cycles("v"), "cycle 10")
        for file in files:
            file.unlink(missing_ok=True)
        until(lambda: server.get("/health")[0] == 503, "a word")
        until(lambda: listener.of("DDEATH", "v"), "the death of a device")
        assert listener.of("NDATA")[-1].values["history/readable"] is False
        assert "<b>Stale.</b>" in server.get("/")[1]
        assert "<b>Stale.</b>" in server.get("/valve/v")[1]
        one = json.loads(server.get("/api/valves/v")[1])
        assert (one["cycle"], one["stale"]) == (10, True)
        metrics = server.get("/metrics")[1]
        assert "valve_twin_history_up 0.0" in metrics
        assert "/v" not in metrics
        until(lambda: not asyncio.run(opcua_says(address.strip(",")))[3], "OPC UA")
        cycle, status, failure, _ = asyncio.run(opcua_says(address.strip(",")))
        assert (cycle, status) == (10, "UncertainLastUsableValue")
        assert "there is no such file" in failure

        aside = tmp_path / "aside.sqlite"
        shutil.copy(backup, aside)
        store_later(aside, range(6, 13))
        aside.replace(path)
        until(lambda: server.get("/health")[0] == 200, "a history that is back")
        until(lambda: (12, False) in listener.cycles("v"), "cycle 12")
        assert {cycle for cycle, _ in listener.cycles("v")} == set(range(1, 13))
        assert json.loads(server.get("/api/valves/v")[1])["stale"] is False
        until(lambda: asyncio.run(opcua_says(address.strip(",")))[:2] == (12, "Good"), "OPC UA")
        assert 'valve_twin_cycle{valve="/v"} 12.0' in server.get("/metrics")[1]
    finally:
        assert server.end() == 0
        broker.kill()
        listener.end()
    said = server.said().splitlines()
    assert len(said) == 2, said
    assert "no such file" in said[0]
    assert said[1].endswith("is read again")
