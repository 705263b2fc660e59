# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Keeps a broker told, in a thread of its own; a broker that is gone stops nobody."""

from __future__ import annotations

import logging
import queue
import random
import select
import threading
import time
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Protocol

import paho.mqtt.client
from paho.mqtt.client import (
    CONNACK_ACCEPTED,
    MQTT_ERR_NO_CONN,
    Client,
    MQTTMessageInfo,
    connack_string,
)

from valve_twin.gateway.descriptors import AnyDescriptor
from valve_twin.gateway.view import View
from valve_twin.io.errors import ValveTwinError

if TYPE_CHECKING:
    from collections.abc import Callable

    from paho.mqtt.client import MQTTMessage

    from valve_twin.gateway.mqtt.broker import Broker, Message

PERIOD_S = 1.0
"""What is shown is renewed so often [s]."""

FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 30.0
"""Between two tries to connect [s]: the pause doubles from the first to the longest."""

CONNECTION_S = 10.0
"""A broker that has not answered by then is tried again [s]."""

KEEPALIVE_S = 10
"""A broker that is silent for one and a half times this is gone [s]."""

MOST_HEARD = 10_000
"""Messages that wait to be read; what comes beyond is dropped: our own data are sent again [1]."""

LARGEST_HEARD = 1 << 16
"""A payload beyond this is dropped, unless it is one of ours that comes back [B]."""

LARGE, MOST_LARGE = 1 << 12, 625
"""Payloads beyond the first [B] only wait among fewer messages than the second [1]: some 80 MB."""

MOST_WAITING = 1000
"""Messages that wait for the network; as long as they do nothing more is said [1]."""

GONE = "the connection broke"

STUCK_S = 30.0
"""A broker that takes nothing for so long is left [s]."""

if hasattr(select, "poll"):  # elsewhere `select` takes any descriptor
    paho.mqtt.client.select = AnyDescriptor

_LOGGER = logging.getLogger("valve_twin")
_Event = tuple[str, Any]


class Speaker(Protocol):
    """Puts what there is to say into messages."""

    @property
    def subscriptions(self) -> tuple[str, ...]:
        """Topics to be heard."""

    def look(self, view: View) -> None:
        """Take note of what there is, before each try to connect."""

    def will(self) -> Message:
        """Return what the broker says when the next connection breaks."""

    def born(self, view: View) -> list[Message]:
        """Return all there is to say to a broker that knows nothing."""

    def changed(self, view: View) -> list[Message]:
        """Return what is new."""

    def missed(self, view: View) -> list[Message]:
        """Return what was not delivered while there was no connection, a part at a time."""

    def heard(self, topic: str, payload: bytes) -> bool:
        """Return whether all is to be said anew."""

    def awaits(self, payload: bytes) -> bytes | None:
        """Return what was sent and comes back now, None if it did not; called by any thread."""

    def farewell(self) -> list[Message]:
        """Return what is said at a clean end."""


class MqttFace:
    """Tells a broker of a plant as long as it runs.

    Parameters
    ----------
    view : callable
        Returns what is to be said; may wait.
    broker : Broker
        Who is told.
    speaker : Speaker
        In what form.

    Raises
    ------
    ConfigError
        If the broker's address is of no use.
    """

    def __init__(self, view: Callable[[], View], broker: Broker, speaker: Speaker) -> None:
        self._view, self._broker, self._speaker = view, broker, speaker
        self._host, self._port = broker.place()
        self._events: queue.Queue[_Event] = queue.Queue()
        self._end = threading.Event()
        self._told = ""
        self._thread = threading.Thread(target=self._run, name="mqtt", daemon=True)

    def start(self) -> str:
        """Begin; return where. Whether the broker is there shows later."""
        self._thread.start()
        return f"{self._host}:{self._port}"

    def stop(self) -> None:
        """Say goodbye."""
        self._end.set()
        self._events.put(("end", None))
        self._thread.join(2.0 * CONNECTION_S)

    def _run(self) -> None:
        pause_s = FIRST_PAUSE_S
        while not self._end.is_set():
            begun_s = time.monotonic()
            why = self._connection()
            if self._end.is_set():
                return
            if time.monotonic() - begun_s > LONGEST_PAUSE_S:
                pause_s = FIRST_PAUSE_S
            self._tell(f"{why}; trying again")
            self._end.wait(pause_s * random.uniform(0.8, 1.2))  # spreads many of us
            pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)

    def _connection(self) -> str:
        """Speak as long as a connection holds; return why it ended."""
        self._events = events = queue.Queue[_Event]()
        client = Client()
        try:
            self._speaker.look(self._view())
            self._broker.apply(client)
            will = self._speaker.will()
            client.will_set(will.topic, will.payload, will.qos, will.retain)
            client.on_connect = lambda _c, _u, _f, code: events.put(("answer", code))
            client.on_disconnect = lambda _c, _u, code: events.put(("gone", code))
            client.on_message = lambda _c, _u, message: _hear(
                events, message, self._speaker.awaits
            )
            client.connect(self._host, self._port, KEEPALIVE_S)
            client.loop_start()
            return _Conversation(client, self._speaker, self._view, events, self._told_all).run(
                self._end
            )
        except (OSError, ValveTwinError) as err:  # ssl.SSLError is one
            return str(err)
        except Exception as err:
            _LOGGER.exception("MQTT: an error of ours")
            return f"{type(err).__name__}: {err}"
        finally:
            client.on_disconnect = None
            client.disconnect()
            client.loop_stop()

    def _told_all(self) -> None:
        self._tell("")

    def _tell(self, why: str) -> None:
        """Say once why there is no connection, and once that there is one again."""
        if why == self._told:
            return
        where = f"MQTT: {self._host}:{self._port}"
        if why:
            _LOGGER.warning("%s: %s", where, why)
        else:
            _LOGGER.warning("%s: connected", where)
        self._told = why


def _hear(
    events: queue.Queue[_Event], message: MQTTMessage, awaits: Callable[[bytes], bytes | None]
) -> None:
    """Keep a message to be read, unless it is none of ours or too many wait.

    A large one of ours is kept as the bytes that were sent, however often somebody repeats it.
    """
    size = len(message.payload)
    if size > LARGEST_HEARD:
        sent = awaits(message.payload)
        if sent is None:
            return
        message.payload, size = sent, 0
    try:
        message.topic.encode()  # made of the bytes that came when it is asked for
    except UnicodeError:
        return
    most = MOST_HEARD if size <= LARGE else min(MOST_HEARD, MOST_LARGE)
    if events.qsize() < most:
        events.put(("heard", message))


class _Conversation:
    """One connection from its answer to its end."""

    def __init__(
        self,
        client: Client,
        speaker: Speaker,
        view: Callable[[], View],
        events: queue.Queue[_Event],
        connected: Callable[[], None],
    ) -> None:
        self._client, self._speaker, self._view = client, speaker, view
        self._events, self._connected = events, connected
        self._waiting: deque[MQTTMessageInfo] = deque()
        self._moved_s = time.monotonic()
        self._answered = self._born = False
        self._shown = View(whole=False)

    def run(self, end: threading.Event) -> str:
        """Speak; return why it ended."""
        try:
            why = self._talk(end)
        except Exception:  # ours: the broker is there and has to know that we are gone
            self._goodbye()
            raise
        if why != GONE:
            self._goodbye()
        return why

    def _talk(self, end: threading.Event) -> str:
        due_s = time.monotonic() + CONNECTION_S
        while not end.is_set():
            if time.monotonic() >= due_s:  # also where there is always something to hear
                if not self._answered:
                    return f"no answer within {CONNECTION_S:g} s"
                if time.monotonic() - self._moved_s > STUCK_S:
                    return f"takes nothing for {STUCK_S:g} s"
                self._speak()
                due_s = time.monotonic() + PERIOD_S
            try:
                what, given = self._events.get(timeout=max(0.0, due_s - time.monotonic()))
            except queue.Empty:
                continue
            if what == "gone":
                return GONE
            if what == "answer":
                if given != CONNACK_ACCEPTED:
                    return str(connack_string(given)).rstrip(".")
                self._answered = True
                self._connected()
                self._begin()
                due_s = time.monotonic() + PERIOD_S
            elif what == "heard" and not given.retain:  # what is retained is of another time
                if self._speaker.heard(given.topic, given.payload):
                    self._born = False
                    self._speak()
                else:
                    self._send(self._speaker.missed(self._shown))
        return ""

    def _begin(self) -> None:
        for topic in self._speaker.subscriptions:
            self._client.subscribe(topic, 1)
        self._speak()

    def _speak(self) -> None:
        """Say what is new, unless what was said still waits."""
        while self._waiting and self._waiting[0].is_published():
            self._waiting.popleft()
            self._moved_s = time.monotonic()
        if not self._waiting:
            self._moved_s = time.monotonic()
        if len(self._waiting) > MOST_WAITING:
            return
        self._shown = self._view()
        if not self._shown.whole and not self._shown.failure:  # yet to be read for the first time
            return
        say = self._speaker.changed if self._born else self._speaker.born
        self._send(say(self._shown))
        self._born = True
        self._send(self._speaker.missed(self._shown))

    def _send(self, messages: list[Message]) -> None:
        for m in messages:
            info = self._client.publish(m.topic, m.payload, m.qos, m.retain)
            if info.rc == MQTT_ERR_NO_CONN:
                raise ConnectionError(GONE)
            self._waiting.append(info)

    def _goodbye(self) -> None:
        """Say that we are gone: a clean end keeps the broker from saying so itself."""
        if not self._answered:
            return
        with suppress(OSError, RuntimeError, ValueError):  # it is gone, too
            self._send(self._speaker.farewell())
            for info in self._waiting:
                info.wait_for_publish(1.0)
                if not info.is_published():
                    return
