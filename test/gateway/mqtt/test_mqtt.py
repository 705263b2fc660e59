# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""One connection from its answer to its end, with a client that is none."""

from __future__ import annotations

import queue
import threading
import time
from types import SimpleNamespace

import pytest

pytest.importorskip("paho.mqtt.client", reason="needs the extra gateway")

from paho.mqtt.client import CONNACK_ACCEPTED, MQTT_ERR_NO_CONN, MQTTMessage

from test.ports import free_port
from valve_twin.gateway.mqtt import face
from valve_twin.gateway.mqtt.broker import Broker, Message
from valve_twin.gateway.view import View
from valve_twin.io.errors import StoreError

HEARD = SimpleNamespace(topic="t", payload=b"", retain=False)


class Client:
    """Takes everything."""

    def __init__(self, rc=0):
        self.said, self.rc = [], rc

    def subscribe(self, *_):
        """Take no notice."""

    def publish(self, topic, *_):
        self.said.append(topic)
        return SimpleNamespace(
            rc=self.rc, is_published=lambda: True, wait_for_publish=lambda _: None
        )


class Speaker:
    """Says what it was asked for; nothing is new but the births."""

    subscriptions = ()

    def __init__(self):
        self.heard_of = []

    def born(self, view):
        del view
        return [Message("birth", b"")]

    def changed(self, view):
        del view
        return [Message("change", b"")]

    def missed(self, view):
        del view
        return []

    def heard(self, topic, payload):
        self.heard_of.append((topic, payload))
        return False

    def awaits(self, payload):
        del payload

    def farewell(self):
        return [Message("death", b"")]

    def look(self, view):
        """Take no note."""

    def will(self):
        return Message("death", b"")


def conversation(client, speaker, view=View):
    events: queue.Queue[face._Event] = queue.Queue()
    events.put(("answer", CONNACK_ACCEPTED))
    told = face._Conversation(client, speaker, view, events, lambda: None)
    return told, events


def test_what_is_new_is_said_while_there_is_always_something_to_hear(monkeypatch):
    monkeypatch.setattr(face, "PERIOD_S", 0.01)
    client, speaker, end = Client(), Speaker(), threading.Event()
    told, events = conversation(client, speaker)
    events.put(("heard", HEARD))

    def heard(topic, payload):
        speaker.heard_of.append((topic, payload))
        events.put(("heard", HEARD))
        if client.said.count("change") >= 3 or len(speaker.heard_of) > 1_000_000:
            end.set()
        return False

    monkeypatch.setattr(speaker, "heard", heard)
    assert told.run(end) == ""
    assert client.said == ["birth", "change", "change", "change", "death"]


def test_nothing_is_born_before_the_history_was_read_for_the_first_time(monkeypatch):
    monkeypatch.setattr(face, "PERIOD_S", 0.0)
    client, end = Client(), threading.Event()
    views = iter([View(whole=False), View(whole=False), View(failure="locked", whole=False)])
    said: list[list[str]] = []

    def view():
        said.append(list(client.said))
        found = next(views, None)
        if found is None:
            end.set()
        return found or View()

    told, _ = conversation(client, Speaker(), view)
    assert told.run(end) == ""
    assert said == [[], [], [], ["birth"]]


def test_a_broker_that_is_left_for_an_error_of_ours_hears_of_it(monkeypatch):
    client, speaker = Client(), Speaker()

    def missed(view):
        del view
        msg = "the disk is full"
        raise StoreError(msg)

    monkeypatch.setattr(speaker, "missed", missed)
    with pytest.raises(StoreError):
        conversation(client, speaker)[0].run(threading.Event())
    assert client.said == ["birth", "death"]


def test_an_error_of_ours_before_a_connection_ends_no_thread(monkeypatch, caplog):
    monkeypatch.setattr(face, "FIRST_PAUSE_S", 0.01)
    looks = []

    def view():
        looks.append(1)
        if len(looks) == 1:
            raise KeyError(len(looks))
        return View()

    broker = Broker(f"mqtt://127.0.0.1:{free_port()}")
    own = face.MqttFace(view, broker, Speaker())
    own.start()
    end_s = time.monotonic() + 60.0
    while len(looks) < 2:
        assert time.monotonic() < end_s
        time.sleep(0.01)  # polls
    own.stop()
    assert "an error of ours" in caplog.text


def test_a_connection_that_broke_meanwhile_is_no_error_of_ours():
    client = Client(MQTT_ERR_NO_CONN)
    with pytest.raises(ConnectionError, match="the connection broke"):
        conversation(client, Speaker())[0].run(threading.Event())


def test_what_is_retained_delivers_nothing():
    client, speaker = Client(), Speaker()
    told, events = conversation(client, speaker)
    events.put(("heard", SimpleNamespace(topic="t", payload=b"old", retain=True)))
    events.put(("heard", HEARD))
    events.put(("gone", 1))
    assert told.run(threading.Event()) == "the connection broke"
    assert speaker.heard_of == [("t", b"")]
    assert "death" not in client.said


def nothing(payload: bytes) -> None:
    """Await nothing."""
    del payload


def test_what_nobody_reads_is_not_kept_without_end(monkeypatch):
    monkeypatch.setattr(face, "MOST_HEARD", 3)
    events: queue.Queue[face._Event] = queue.Queue()
    for _ in range(9):
        face._hear(events, HEARD, nothing)
    assert events.qsize() == 3


def message(payload: bytes, topic=b"spBv1.0/g/DDATA/n/a"):
    made = MQTTMessage(1, topic)
    made.payload = payload
    return made


def test_large_messages_of_others_take_no_memory_and_topics_that_are_no_text_harm_nobody():
    events: queue.Queue[face._Event] = queue.Queue()
    for n in range(20_000):
        face._hear(events, message(bytes(face.LARGEST_HEARD if n % 2 else 10)), nothing)
    kept = [len(given.payload) for _, given in events.queue]
    assert len(kept) == face.MOST_HEARD
    assert sum(kept) < 80_000_000
    events = queue.Queue()
    face._hear(events, message(bytes(face.LARGEST_HEARD + 1)), nothing)
    face._hear(events, message(b"1", b"spBv1.0/g/DDATA/n/\xff"), nothing)
    assert events.empty()


def test_a_broker_that_is_gone_for_a_day_is_told_once_and_tried_twice_a_minute(
    monkeypatch, caplog
):
    speaker = Speaker()
    pauses: list[float] = []

    def wait(pause_s):
        pauses.append(pause_s)
        if sum(pauses) > 86_400.0:
            told._end.set()

    threads = threading.active_count()
    told = face.MqttFace(View, Broker(f"mqtt://127.0.0.1:{free_port()}"), speaker)
    monkeypatch.setattr(told._end, "wait", wait)
    told._run()
    assert max(pauses) <= 1.2 * face.LONGEST_PAUSE_S
    assert len(pauses) == pytest.approx(86_400.0 / face.LONGEST_PAUSE_S, rel=0.05)
    assert [r.getMessage().partition("; ")[2] for r in caplog.records] == ["trying again"]
    assert threading.active_count() == threads
