# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The faces beside the pages, as `valve-twin serve` and the node `gateway` open them."""

from __future__ import annotations

import logging
import os
import threading
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.io.errors import ConfigError, ValveTwinError, may_pass

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from valve_twin.gateway.foxglove.face import FoxgloveFace
    from valve_twin.gateway.mqtt.face import Speaker
    from valve_twin.gateway.plant import Plant
    from valve_twin.io.config.gateway_parameters import FaceParameters

RETRY_S, LAST_RETRY_S = 5.0, 60.0
"""Pause before a face that a full, read-only or missing disk held up is tried again; doubled until
the last one [s]."""


class Faces:
    """What is open of what was asked for.

    Attributes
    ----------
    foxglove : FoxgloveFace or None
        The one that takes live topics.
    """

    def __init__(self) -> None:
        self.foxglove: FoxgloveFace | None = None
        self._openings: list[_Opening] = []

    def add(self, opening: _Opening) -> None:
        """Keep one that may open later."""
        self._openings.append(opening)

    @property
    def closed(self) -> tuple[str, ...]:
        """Why those that are not open are not, as it was told."""
        return tuple(opening.closed for opening in self._openings if opening.closed)


@contextmanager
def faces(plant: Plant, given: FaceParameters, tell: Callable[[str], None]) -> Iterator[Faces]:
    """Open what is asked for, and close it at the end.

    None waits for a first reading of the history: each shows its valves once that is done. One
    whose folder cannot be written says so and is opened once it can be; nothing waits for it.

    Parameters
    ----------
    plant : Plant
        What is shown.
    given : FaceParameters
        Which faces, and where.
    tell : callable
        Gets a line for each, and later where something of one is to be told.

    Raises
    ------
    ConfigError, ValveTwinError
        If one cannot be opened, in one line.
    """
    made = Faces()
    with ExitStack() as stack:
        try:
            if given.opcua:
                made.add(_open_opcua(stack, plant, given, tell))
            if given.mqtt:
                made.add(_open_mqtt(stack, plant, given, tell))
            if given.foxglove >= 0:
                made.foxglove = _open_foxglove(stack, plant, given, tell)
        except ModuleNotFoundError as err:
            msg = f"{err.name} is missing: pip install valve_twin[gateway]"
            raise ConfigError(msg) from err
        yield made


def _open_opcua(
    stack: ExitStack, plant: Plant, given: FaceParameters, tell: Callable[[str], None]
) -> _Opening:
    from valve_twin.gateway.opcua.access import Access
    from valve_twin.gateway.opcua.server import OpcUaFace
    from valve_twin.gateway.passwords import Passwords, read_users

    logging.getLogger("asyncua").setLevel(logging.CRITICAL + 1)  # traces of what clients do wrong
    users = given.opcua_users
    passwords = Passwords(read_users(users, "--opcua-add-user"), tell) if users else None
    folder = Path(given.opcua_pki).expanduser()
    access = Access(folder, passwords, given.opcua_anonymous)

    def opened(within: ExitStack) -> str:
        face = OpcUaFace(plant.news, given.opcua, access)
        within.callback(face.stop)
        return f"OPC UA at {face.start()}, certificates in {folder}"

    return _Opening(stack, opened, tell)


def _open_mqtt(
    stack: ExitStack, plant: Plant, given: FaceParameters, tell: Callable[[str], None]
) -> _Opening:
    from valve_twin.gateway.mqtt.backlog import Backlog
    from valve_twin.gateway.mqtt.broker import Broker
    from valve_twin.gateway.mqtt.face import MqttFace
    from valve_twin.gateway.mqtt.names import checked_id
    from valve_twin.gateway.mqtt.plain import JsonSpeaker
    from valve_twin.gateway.mqtt.sparkplug import SparkplugSpeaker

    password = os.environ.get("VALVE_TWIN_MQTT_PASSWORD", "")
    files = given.mqtt_ca, given.mqtt_cert, given.mqtt_key
    broker = Broker(given.mqtt, given.mqtt_user, password, *files)
    group = checked_id("--mqtt-group", given.mqtt_group)
    plain = given.mqtt_format == "json"
    node = "" if plain else checked_id("--mqtt-node", given.edge_node)
    broker.check()

    def opened(within: ExitStack) -> str:
        speaker: Speaker = JsonSpeaker(group)
        if not plain:
            of = f"{broker.address} {group}/{node}, {plant.where}"
            backlog = Backlog(Path(given.mqtt_state).expanduser(), plant.estimates, of)
            within.callback(backlog.close)
            speaker = SparkplugSpeaker(group, node, backlog)
        face = MqttFace(plant.news, broker, speaker)
        within.callback(face.stop)
        return f"MQTT to {face.start()}"

    return _Opening(stack, opened, tell)


class _Opening:
    """Opens a face; one that a disk holds up is said once and tried again, on a thread of its own.

    Parameters
    ----------
    stack : ExitStack
        Ends it.
    opened : callable
        Opens the face, closes it with the stack that it gets, and returns what is told of it.
    tell : callable
        Gets a line.

    Attributes
    ----------
    closed : str
        Why it is not open; empty = it is.

    Raises
    ------
    ValveTwinError
        If it cannot be opened and no disk is the cause.
    """

    def __init__(
        self, stack: ExitStack, opened: Callable[[ExitStack], str], tell: Callable[[str], None]
    ) -> None:
        self._opened, self._tell, self.closed = opened, tell, ""
        self._within, self._end = ExitStack(), threading.Event()
        stack.callback(self._within.close)
        if self._is_open():
            return
        thread = threading.Thread(target=self._wait, name="disk", daemon=True)
        stack.callback(thread.join)
        stack.callback(self._end.set)
        thread.start()

    def _is_open(self) -> bool:
        try:
            with ExitStack() as made:
                told = self._opened(made)
                self._within.push(made.pop_all())
        except ValveTwinError as err:
            if not may_pass(err):
                raise
            told = f"{err}; it is tried again, the other faces go on"
            if told != self.closed:
                self._tell(told)
            self.closed = told
            return False
        self.closed = ""
        self._tell(told)
        return True

    def _wait(self) -> None:
        pause_s = RETRY_S
        while not self._end.wait(pause_s):
            try:
                if self._is_open():
                    return
            except ValveTwinError as err:  # it is there, and says something else
                self.closed = f"{err}; start anew"
                self._tell(self.closed)
                return
            pause_s = min(2.0 * pause_s, LAST_RETRY_S)


def _open_foxglove(
    stack: ExitStack, plant: Plant, given: FaceParameters, tell: Callable[[str], None]
) -> FoxgloveFace:
    from valve_twin.gateway.foxglove.face import FoxgloveFace

    logging.getLogger("foxglove").setLevel(logging.CRITICAL + 1)  # a line for each wrong request
    face = FoxgloveFace(plant.news, plant.estimates, given.host, given.foxglove)
    tell(f"Foxglove at {face.start()}")
    stack.callback(face.stop)
    return face
