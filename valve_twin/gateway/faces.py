# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The faces beside the pages, as `valve-twin serve` and the node `gateway` open them."""

from __future__ import annotations

import logging
import os
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.io.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from valve_twin.gateway.foxglove.face import FoxgloveFace
    from valve_twin.gateway.mqtt.face import Speaker
    from valve_twin.gateway.plant import Plant
    from valve_twin.io.config.gateway_parameters import FaceParameters


@contextmanager
def faces(
    plant: Plant, given: FaceParameters, tell: Callable[[str], None]
) -> Iterator[FoxgloveFace | None]:
    """Open what is asked for, and close it at the end; yield the one that takes live topics.

    None waits for a first reading of the history: each shows its valves once that is done.

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
    with ExitStack() as stack:
        try:
            if given.opcua:
                _open_opcua(stack, plant, given, tell)
            if given.mqtt:
                _open_mqtt(stack, plant, given, tell)
            foxglove = _open_foxglove(stack, plant, given, tell) if given.foxglove >= 0 else None
        except ModuleNotFoundError as err:
            msg = f"{err.name} is missing: pip install valve_twin[gateway]"
            raise ConfigError(msg) from err
        yield foxglove


def _open_opcua(
    stack: ExitStack, plant: Plant, given: FaceParameters, tell: Callable[[str], None]
) -> None:
    from valve_twin.gateway.opcua.access import Access
    from valve_twin.gateway.opcua.server import OpcUaFace
    from valve_twin.gateway.passwords import Passwords, read_users

    logging.getLogger("asyncua").setLevel(logging.CRITICAL + 1)  # traces of what clients do wrong
    users = given.opcua_users
    passwords = Passwords(read_users(users, "--opcua-add-user"), tell) if users else None
    folder = Path(given.opcua_pki).expanduser()
    access = Access(folder, passwords, given.opcua_anonymous)
    face = OpcUaFace(plant.news, given.opcua, access)
    stack.callback(face.stop)
    tell(f"OPC UA at {face.start()}, certificates in {folder}")


def _open_mqtt(
    stack: ExitStack, plant: Plant, given: FaceParameters, tell: Callable[[str], None]
) -> None:
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
    speaker: Speaker = JsonSpeaker(group)
    if given.mqtt_format != "json":
        node = checked_id("--mqtt-node", given.edge_node)
        of = f"{broker.address} {group}/{node}, {plant.where}"
        backlog = Backlog(Path(given.mqtt_state).expanduser(), plant.estimates, of)
        stack.callback(backlog.close)
        speaker = SparkplugSpeaker(group, node, backlog)
    face = MqttFace(plant.news, broker, speaker)
    tell(f"MQTT to {face.start()}")
    stack.callback(face.stop)


def _open_foxglove(
    stack: ExitStack, plant: Plant, given: FaceParameters, tell: Callable[[str], None]
) -> FoxgloveFace:
    from valve_twin.gateway.foxglove.face import FoxgloveFace

    logging.getLogger("foxglove").setLevel(logging.CRITICAL + 1)  # a line for each wrong request
    face = FoxgloveFace(plant.news, plant.estimates, given.host, given.foxglove)
    tell(f"Foxglove at {face.start()}")
    stack.callback(face.stop)
    return face
