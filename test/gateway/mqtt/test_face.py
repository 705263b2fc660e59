# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The MQTT face as `valve-twin serve` starts it, a broker by others (amqtt), who listens."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
import urllib.request
from collections import Counter
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("pysparkplug", reason="needs the extra gateway")
pytest.importorskip("amqtt", reason="needs the broker amqtt")

from pysparkplug import DataType, Metric, NCmd

from test.gateway.mqtt.brokers import GROUP, NODE, Broker, Listener, wait_until
from test.gateway.test_web import HOSTILE, store
from test.io.history.test_fleet import estimate, record
from valve_twin.cli import main
from valve_twin.gateway.mqtt.broker import Broker as BrokerOfOurs
from valve_twin.gateway.mqtt.face import LARGEST_HEARD, MqttFace
from valve_twin.gateway.mqtt.names import device_id
from valve_twin.gateway.mqtt.plain import JsonSpeaker
from valve_twin.gateway.plain import plain_valve, plain_words
from valve_twin.gateway.view import LastCycle, NodeFault, View
from valve_twin.io.history.fleet import FleetRow
from valve_twin.io.history.store import History

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


class Server:
    """`valve-twin serve --mqtt`."""

    def __init__(self, history: Path, broker: str, state: Path, *more: str) -> None:
        command = [sys.executable, "-m", "valve_twin.cli", "serve", "--port", "0"]
        command += ["--url", f"sqlite:///{history}", "--mqtt", broker, "--mqtt-group", GROUP]
        command += ["--mqtt-node", NODE, "--mqtt-state", str(state), *more]
        self._said = state.with_name(f"{state.name}.{time.monotonic_ns()}.log")
        with self._said.open("w") as stream:
            self.process = subprocess.Popen(command, stderr=stream, text=True)
        wait_until(lambda: "http://" in self.said() or self.process.poll() is not None, "a server")

    def said(self) -> str:
        return self._said.read_text()

    def json(self) -> dict[str, Any]:
        found = re.search(r"http://127\.0\.0\.1:\d+", self.said())
        assert found
        with urllib.request.urlopen(f"{found.group()}/api/valves", timeout=30) as answer:
            return {row["valve"]: row for row in json.load(answer)["valves"]}

    def end(self) -> str:
        self.process.send_signal(signal.SIGINT)
        try:
            assert self.process.wait(30) == 0
        finally:
            self.process.kill()
        assert "Traceback" not in self.said()
        return self.said()


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Broker]:
    made = Broker(tmp_path)
    yield made
    made.kill()


@pytest.fixture
def listener(broker: Broker) -> Iterator[Listener]:
    made = Listener(broker)
    yield made
    made.end()


@pytest.fixture
def history(tmp_path: Path) -> Path:
    made = tmp_path / "history.sqlite"
    store(made, "/press/worn", range(1, 61), -0.0045)
    store(made, HOSTILE, range(1, 3), 0.0)
    return made


def test_a_node_is_born_says_what_changes_and_dies(broker, listener, history, tmp_path):
    server = Server(history, broker.address, tmp_path / "state.json")
    try:
        wait_until(lambda: listener.of("DBIRTH", device_id(HOSTILE)), "a birth of each valve")
        node, *devices = [h for h in listener.heard if h.kind in {"NBIRTH", "DBIRTH"}]
        assert node.kind == "NBIRTH"
        assert [node.payload.seq, *(d.payload.seq for d in devices)] == [0, 1, 2]
        assert node.values["history/readable"] is True
        born = listener.of("DBIRTH", "press.worn")[0].values
        shown = server.json()["/press/worn"]
        assert born["verdict"] == shown["verdict"] == "valve"
        assert born["cycle"] == shown["cycle"] == 60
        assert born["drift"] == shown["drift"]
        assert born["end"].timestamp() == pytest.approx(shown["end_ns"] * 1e-9, abs=1e-3)
        level = next(p for p in shown["parameters"] if p["parameter"] == "K_in")
        assert born["parameters/K_in/level"] == level["level"]
        assert born["parameters/K_in/unit"] == level["unit"]
        assert born["parameters/K_in/remaining"] == level["remaining"]

        store(history, "/press/worn", range(61, 62), -0.0045)
        wait_until(lambda: (61, False) in listener.cycles("press.worn"), "the new cycle")
        told = next(
            h for h in listener.of("DDATA", "press.worn") if h.values.get("cycles/cycle") == 61
        )
        assert told.values["cycles/K_in/value"] == pytest.approx(
            0.01 * (1 - 0.0045 * 61 - 0.003), rel=1e-12
        )
        declared = {
            m.name: m.datatype for m in listener.of("DBIRTH", "press.worn")[0].payload.metrics
        }
        for data in listener.of("DDATA", "press.worn"):
            assert {m.name: m.datatype for m in data.payload.metrics}.items() <= declared.items()
        assert not listener.cycles(
            device_id(HOSTILE)
        )  # what was there at the first start is known

        command = Metric(None, "Node Control/Rebirth", DataType.BOOLEAN, value=True)
        order = NCmd(time.time_ns() // 1_000_000, (command,)).encode(include_dtypes=True)
        time.sleep(1.1)  # at most one birth a second is given on demand
        listener.client.publish(f"spBv1.0/{GROUP}/NCMD/{NODE}", order, 1)
        listener.client.publish(f"spBv1.0/{GROUP}/NCMD/{NODE}", b"\xff no payload", 1)
        wait_until(lambda: len(listener.of("NBIRTH")) == 2, "another birth")
        assert listener.of("NBIRTH")[1].payload.seq == 0
        assert not listener.of("NDEATH")
    finally:
        server.end()
    wait_until(lambda: listener.of("NDEATH"), "a death")
    assert listener.of("NDEATH")[-1].payload.bd_seq_metric.value == node.values["bdSeq"]
    sequence = [h.payload.seq for h in listener.heard if h.kind != "NDEATH"]
    again = sequence.index(0, 1)
    assert sequence == [*range(again), *range(len(sequence) - again)]


def is_known(state: Path, cycle: int) -> bool:
    """Return whether the broker is known to have handed a cycle on."""
    valves = json.loads(state.read_text())["valves"] if state.exists() else None
    return bool(valves and valves["/press/worn"] == cycle)


def knows(server: Server, cycle: int) -> bool:
    """Return whether a server shows a cycle."""
    return bool(server.json()["/press/worn"]["cycle"] == cycle)


def test_no_stored_cycle_is_lost_over_outages_of_broker_and_server(
    broker, listener, history, tmp_path
):
    state = tmp_path / "state.json"
    server = Server(history, broker.address, state)
    last = 60
    wait_until(lambda: listener.of("DBIRTH", "press.worn"), "a birth")
    for outage in range(3):
        if outage % 2:
            server.process.kill()
            server.process.wait(30)
        else:
            broker.kill()
        store(history, "/press/worn", range(last + 1, last + 71), -0.0045)
        last += 70
        if outage % 2:
            wait_until(lambda: listener.of("NDEATH"), "the will")
            server = Server(history, broker.address, state)
        else:
            listener.wait_gone()
            wait_until(partial(knows, server, last), "a server that has read all")
            server.process.send_signal(signal.SIGSTOP)  # what the listener misses is not lost
            broker.start()
            listener.wait_there()
            server.process.send_signal(signal.SIGCONT)
        wait_until(partial(is_known, state, last), f"cycle {last}")
    server.end()
    heard = listener.cycles("press.worn")
    counts = Counter(cycle for cycle, _ in heard)
    assert sorted(counts) == list(range(61, last + 1))
    assert max(counts.values()) <= 2  # under way when the connection broke
    first = list(dict.fromkeys(cycle for cycle, _ in heard))
    assert first == sorted(first)
    assert all(old for cycle, old in heard if (cycle - 60) % 70)
    numbers = [h.values["bdSeq"] for h in listener.of("NBIRTH")]
    assert len(set(numbers)) == len(numbers)


def test_a_stored_cycle_that_is_large_is_delivered_once(broker, listener, history, tmp_path):
    server = Server(history, broker.address, tmp_path / "state.json")
    wait_until(lambda: listener.of("DBIRTH", "press.worn"), "a birth")
    with History(history) as opened:
        for cycle in (61, 62):
            told = replace(estimate(cycle, {"K_in": 0.0075}), reason=f"{cycle}" * LARGEST_HEARD)
            opened.store("/press/worn", record(cycle), (told,))
    wait_until(partial(is_known, tmp_path / "state.json", 62), "the cycles")
    server.end()
    assert [cycle for cycle, _ in listener.cycles("press.worn")] == [61, 62]


def test_plain_json_is_retained_and_says_when_nobody_speaks_any_more(
    broker, listener, history, tmp_path
):
    server = Server(history, broker.address, tmp_path / "s", "--mqtt-format", "json")
    topic = f"{GROUP}/valves/press/worn"
    wait_until(lambda: any(t == topic for t, _, _ in listener.raw), "the valve")
    late = Listener(broker)
    try:
        wait_until(lambda: any(t == topic for t, _, _ in late.raw), "the retained valve")
        kept = {t: (json.loads(p), retained) for t, p, retained in late.raw}
        found, retained = kept[topic]
        assert (found, retained) == (server.json()["/press/worn"], True)
        assert kept[f"{GROUP}/faults"] == ([], True)
        assert kept[f"{GROUP}/online"] == (True, True)
        assert len([t for t in kept if t.startswith(f"{GROUP}/valves/")]) == 2
        server.process.kill()
        server.process.wait(30)
        wait_until(
            lambda: (f"{GROUP}/online", b"false") in [(t, p) for t, p, _ in listener.raw],
            "the will",
        )
    finally:
        late.end()


def test_last_cycles_and_faults_of_nodes_are_told_as_json_while_they_last(broker, listener):
    row, words = FleetRow("/press/a"), LastCycle(7, 10**18, accepted=False, reason="too short")
    faults = (NodeFault("/press/a/twin", "/press/a", "input.silent"),
              NodeFault("/bag_recorder", "", "recorder.disk"))  # fmt: skip
    shown = [View((row,), "history", 1)]
    broker_of_ours = BrokerOfOurs(broker.address)
    face = MqttFace(lambda: shown[0], broker_of_ours, JsonSpeaker(GROUP))
    face.start()

    def heard(topic: str) -> Any:
        told = [p for t, p, _ in list(listener.raw) if t == f"{GROUP}/{topic}"]
        return json.loads(told[-1]) if told else None

    valve = partial(heard, "valves/press/a")
    try:
        wait_until(lambda: valve() and heard("faults") == [], "the valve")
        assert (valve()["last"], valve()["faults"]) == (None, [])
        shown[0] = replace(shown[0], last={row.valve: words}, faults=faults)
        wait_until(lambda: valve()["last"], "the last cycle")
        wait_until(lambda: heard("faults"), "the faults")
        assert valve() == plain_valve(shown[0], row) | plain_words(shown[0], row)
        assert [f["code"] for f in valve()["faults"]] == ["input.silent"]
        assert [f["code"] for f in heard("faults")] == ["input.silent", "recorder.disk"]
        shown[0] = replace(shown[0], faults=faults[1:])
        wait_until(lambda: valve()["faults"] == [], "the end of the fault")
        assert valve()["last"]["reason"] == "too short"
    finally:
        face.stop()


def test_a_wrong_user_is_told_in_one_line_and_the_pages_go_on(tmp_path, history, monkeypatch):
    guarded = Broker(tmp_path, guarded=True)
    try:
        monkeypatch.setenv("VALVE_TWIN_MQTT_PASSWORD", "wrong")
        server = Server(history, guarded.address, tmp_path / "a", "--mqtt-user", "anna")
        wait_until(lambda: "trying again" in server.said(), "a word about it")
        assert server.json()
        time.sleep(2.5)  # two further tries are made and not told again
        said = server.end()
        assert said.count("trying again") == 1
        monkeypatch.setenv("VALVE_TWIN_MQTT_PASSWORD", "right")
        server = Server(history, guarded.address, tmp_path / "b", "--mqtt-user", "anna")
        wait_until(partial(is_known, tmp_path / "b", 60), "a conversation")
        assert "trying again" not in server.end()
    finally:
        guarded.kill()


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (("--mqtt", "http://x"), "MQTT: 'http://x' is no address: write mqtt://127.0.0.1:1883"),
        (("--mqtt", "mqtt://x:99999"), "MQTT: 'mqtt://x:99999' is no address"),
        (("--mqtt-ca", "nowhere.pem"), "MQTT: certificates are of no use for mqtt://127.0.0.1"),
        (("--mqtt", "mqtts://x", "--mqtt-ca", "nowhere.pem"), "nowhere.pem cannot be used: "),
        (("--mqtt", "mqtts://x", "--mqtt-key", "k.pem"), "certificate and its key belong togeth"),
        (("--mqtt-group", "a/b"), "MQTT: --mqtt-group 'a/b' is no level of a topic"),
        (("--mqtt-node", ""), "MQTT: --mqtt-node '' is no level of a topic"),
    ],
)
def test_what_cannot_be_used_is_told_in_one_line(more, told, history, tmp_path, capsys):
    given = ["serve", "--port", "0", "--url", str(history), "--mqtt", "mqtt://127.0.0.1"]
    assert main([*given, "--mqtt-state", str(tmp_path / "state"), *more]) != 0
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line


@pytest.mark.parametrize(
    "text", ["", "{}", "[1]", '{"birth": 0, "valves": {"/a": "x"}}', "[" * 100_000]
)
def test_marks_that_are_none_are_told(text, history, tmp_path, capsys):
    state = tmp_path / "state"
    state.write_text(text)
    given = ["serve", "--port", "0", "--url", str(history), "--mqtt", "mqtt://127.0.0.1"]
    assert main([*given, "--mqtt-state", str(state)]) == 1
    assert f"{state}: holds no marks of MQTT" in capsys.readouterr().err
