# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Outages of a broker with TLS and passwords: every stored cycle is heard, in order."""

from __future__ import annotations

import json
import logging
import resource
import threading
from collections import Counter
from contextlib import ExitStack
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("pysparkplug", reason="needs the extra gateway")
pytest.importorskip("amqtt", reason="needs the broker amqtt")

from test.gateway.mqtt.brokers import (
    GROUP,
    NODE,
    PASSWORD,
    USER,
    Broker,
    Listener,
    Mosquitto,
    make_pair,
    wait_until,
)
from test.gateway.test_web import Server, store
from test.small_disk import small_disk
from valve_twin.gateway import plant as plant_module
from valve_twin.gateway.mqtt import face as face_module
from valve_twin.gateway.mqtt.backlog import Backlog
from valve_twin.gateway.mqtt.broker import Broker as Address
from valve_twin.gateway.mqtt.face import MqttFace
from valve_twin.gateway.mqtt.sparkplug import SparkplugSpeaker
from valve_twin.gateway.plant import Plant

if TYPE_CHECKING:
    from collections.abc import Iterator

    from test.gateway.mqtt.brokers import Pair
    from valve_twin.gateway.mqtt.broker import Message

VALVE, DEVICE = "/press/worn", "press.worn"
FIRST, EACH = 5, 3
"""Cycles before the first start and in each outage."""


@pytest.fixture
def pair(tmp_path: Path) -> Pair:
    return make_pair(tmp_path)


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plant_module, "REFRESH_S", 0.1)
    monkeypatch.setattr(plant_module, "REST", 0.0)
    monkeypatch.setattr(face_module, "PERIOD_S", 0.1)
    monkeypatch.setattr(face_module, "FIRST_PAUSE_S", 0.1)
    monkeypatch.setattr(face_module, "LONGEST_PAUSE_S", 0.2)


class Speaker(SparkplugSpeaker):
    """Connects when the listener is there: what he misses is not what we lose."""

    gate = threading.Event()

    def will(self) -> Message:
        """Wait; then as ever."""
        self.gate.wait(60.0)
        return super().will()


class Told:
    """Plant, marks and face as `serve` makes them."""

    def __init__(self, history: Path, broker: Broker, password: str = PASSWORD) -> None:
        plant = Plant(str(history))
        self.state = history.with_name("state.json")
        self._backlog = Backlog(self.state, plant.estimates, "a broker")
        ca = str(broker.pair.ca) if broker.pair else ""
        address = Address(broker.address, USER, password, ca)
        self.face = MqttFace(plant.view, address, Speaker(GROUP, NODE, self._backlog))
        self.face.start()

    def knows(self, cycle: int) -> bool:
        valves = json.loads(self.state.read_text())["valves"] if self.state.exists() else None
        return bool(valves and valves[VALVE] == cycle)

    def end(self) -> None:
        self.face.stop()
        self._backlog.close()


@pytest.fixture
def history(tmp_path: Path) -> Iterator[Path]:
    made = tmp_path / "history.sqlite"
    store(made, VALVE, range(1, FIRST + 1), -0.0045)
    yield made
    Speaker.gate.set()


@pytest.mark.parametrize("kind", [Broker, Mosquitto])
@pytest.mark.parametrize(
    "outages", [4, pytest.param(100, marks=[pytest.mark.slow, pytest.mark.timeout(3600)])]
)
def test_every_cycle_is_heard_in_order_over_outages(
    kind, outages, history, pair, tmp_path, at_once
):
    broker = kind(tmp_path, guarded=True, pair=pair)
    listener = Listener(broker)
    Speaker.gate.set()
    told = Told(history, broker)
    last = FIRST
    try:
        wait_until(lambda: listener.of("DBIRTH", DEVICE), "a birth")
        for outage in range(outages):
            Speaker.gate.clear()
            broker.kill()
            store(history, VALVE, range(last + 1, last + 1 + EACH), -0.0045)
            last += EACH
            if outage % 10 == 3:  # the marks outlive us
                Speaker.gate.set()
                told.end()
                Speaker.gate.clear()
                told = Told(history, broker)
            listener.wait_gone()
            broker.start()
            listener.wait_there()
            Speaker.gate.set()
            wait_until(partial(told.knows, last), f"cycle {last}")
        wait_until(lambda: (last, False) in listener.cycles(DEVICE), "the last cycle")
    finally:
        Speaker.gate.set()
        told.end()
        broker.kill()
        listener.end()
    heard = listener.cycles(DEVICE)
    counts = Counter(cycle for cycle, _ in heard)
    assert sorted(counts) == list(range(FIRST + 1, last + 1))
    assert max(counts.values()) <= 2  # under way when the connection broke
    first = list(dict.fromkeys(cycle for cycle, _ in heard))
    assert first == sorted(first)
    births = [h.values["bdSeq"] for h in listener.of("NBIRTH")]
    assert len(births) >= outages + 1
    assert all(a != b for a, b in pairwise(births))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # paho leaves the
# socket of a handshake that failed to the garbage collector
@pytest.mark.parametrize("kind", [Broker, Mosquitto])
def test_a_wrong_password_and_an_authority_that_is_not_trusted_are_told(
    kind, history, pair, tmp_path, at_once, caplog
):
    broker = kind(tmp_path, guarded=True, pair=pair)
    other = tmp_path / "other"
    other.mkdir()
    strange = make_pair(other)
    Speaker.gate.set()
    try:
        with caplog.at_level(logging.WARNING, "valve_twin"):
            told = Told(history, broker, "wrong")
            wait_until(lambda: "trying again" in caplog.text, "a word about the password")
            told.end()
            assert len(caplog.messages) == 1
            assert "refused" in caplog.text.lower()
            caplog.clear()
            broker.pair = strange
            told = Told(history, broker)
            wait_until(lambda: "trying again" in caplog.text, "a word about the certificate")
            told.end()
            assert len(caplog.messages) == 1
            assert "certificate verify failed" in caplog.text
    finally:
        broker.kill()


def test_a_full_disk_under_the_marks_loses_no_cycle_and_doubles_few(tmp_path):
    """From the first start on, over a kill and a start while it is full."""
    history, last = tmp_path / "history.sqlite", 5
    store(history, VALVE, range(1, last + 1), 0.0)
    broker = Mosquitto(tmp_path)
    listener = Listener(broker)

    def start() -> Server:
        mqtt = ("--mqtt", broker.address, "--mqtt-group", GROUP, "--mqtt-node", NODE)
        return Server(history, *mqtt, "--mqtt-state", str(disk.place / "state"))

    def more() -> None:
        nonlocal last
        last += 2
        store(history, VALVE, range(last - 1, last + 1), 0.0)

    def wait_heard() -> None:
        wait_until(lambda: (last, False) in listener.cycles(DEVICE), f"cycle {last}")

    with small_disk(tmp_path / "disk", "1m") as disk:
        disk.fill()
        server = start()
        try:
            wait_until(
                lambda: "no broker is told before" in server.begun + server.said(), "a word"
            )
            more()
            disk.empty()
            wait_heard()
            wait_until(lambda: f'": {last}' in (disk.place / "state").read_text(), "marks")
            disk.fill()
            more()
            wait_heard()
            wait_until(lambda: "is told again what it has" in server.said(), "a word")
            server.kill()
            server = start()
            more()
            wait_heard()
            disk.empty()
            wait_until(lambda: "is written again" in server.said(), "a word")
        finally:
            assert server.end() == 0
            broker.kill()
            listener.end()
        state = json.loads((disk.place / "state").read_text())
    counts = Counter(cycle for cycle, _ in listener.cycles(DEVICE))
    assert sorted(counts) == list(range(6, last + 1))
    assert {cycle for cycle, count in counts.items() if count > 1} <= {8, 9}
    assert max(counts.values()) == 2
    assert state["valves"] == {VALVE: last}
    assert "Traceback" not in server.said()


def test_a_broker_is_told_beside_more_than_a_thousand_clients(history, tmp_path, at_once):
    """Its descriptor was beyond what `select` takes: no connection held until they had gone."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 4096), hard))
    broker = Mosquitto(tmp_path)
    listener = Listener(broker)
    Speaker.gate.set()
    try:
        with ExitStack() as stack:
            most = 0
            while most < 1024:
                most = stack.enter_context(Path("/dev/null").open("rb")).fileno()
            told = Told(history, broker)
            stack.callback(told.end)
            wait_until(lambda: listener.of("DBIRTH", DEVICE), "a birth")
            store(history, VALVE, range(FIRST + 1, FIRST + 2), -0.0045)
            wait_until(lambda: (FIRST + 1, False) in listener.cycles(DEVICE), "a cycle")
    finally:
        broker.kill()
        listener.end()
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
