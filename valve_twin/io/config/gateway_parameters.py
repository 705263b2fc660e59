# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Parameters of the gateway beside those of the valve."""

from __future__ import annotations

import socket
from dataclasses import dataclass

from valve_twin.core.quantity import quantity, setting
from valve_twin.io.config.every_node import NodeParameters


@dataclass(frozen=True, slots=True)
class FaceParameters(NodeParameters):
    """Where the faces beside the pages are, and who may look."""

    host: str = setting(
        "127.0.0.1", "Address to listen at; 127.0.0.1 = this machine only.", local=True
    )
    foxglove: int = quantity(
        -1,
        "1",
        "TCP port for Foxglove at `host`, such as 8765; 0 = any, -1 = off.",
        lower=-1,
        upper=65535,
        local=True,
    )
    opcua: str = setting(
        "", "Address for OPC UA, such as opc.tcp://127.0.0.1:4840; empty = off.", local=True
    )
    opcua_users: str = setting(
        "",
        "File of users who may look by OPC UA, made by `valve-twin serve --opcua-add-user`.",
        local=True,
    )
    opcua_pki: str = setting(
        "~/.config/valve_twin/opcua",
        "Holds certificate.der, key.pem (made where both are missing) and trusted/*.der.",
        local=True,
    )
    opcua_anonymous: bool = setting(
        default=False, text="Let anybody look by OPC UA, unencrypted too.", local=True
    )
    mqtt: str = setting(
        "", "Broker that is told, such as mqtts://broker.plant:8883; empty = none.", local=True
    )
    mqtt_format: str = setting(
        "sparkplug",
        "Sparkplug B, or retained topics of plain JSON.",
        choices=("sparkplug", "json"),
        local=True,
    )
    mqtt_group: str = setting(
        "valve_twin", "Group id of Sparkplug, or prefix of the JSON topics.", local=True
    )
    mqtt_node: str = setting("", "Edge node id; empty = the name of the host.", local=True)
    mqtt_state: str = setting(
        "~/.local/state/valve_twin/mqtt.json",
        "Keeps which cycles the broker has; one for each broker and node.",
        local=True,
    )
    mqtt_user: str = setting("", "User; the password is in VALVE_TWIN_MQTT_PASSWORD.", local=True)
    mqtt_ca: str = setting(
        "", "Authorities (PEM) that we trust; empty = those of the system.", local=True
    )
    mqtt_cert: str = setting("", "Our certificate (PEM) for the broker.", local=True)
    mqtt_key: str = setting("", "Its key (PEM).", local=True)

    @property
    def edge_node(self) -> str:
        """Edge node id of Sparkplug."""
        return self.mqtt_node or socket.gethostname()


@dataclass(frozen=True, slots=True)
class GatewayParameters(FaceParameters):
    """Parameters of the gateway."""

    port: int = quantity(
        8107, "1", "TCP port; 0 = any that is free.", lower=0, upper=65535, local=True
    )
    certificate: str = setting("", "Certificate (PEM) for TLS; empty = without TLS.", local=True)
    key: str = setting("", "Its key (PEM).", local=True)
    users: str = setting(
        "",
        "File of users who may mark and acknowledge on the page, made by `valve-twin serve "
        "--add-user`; empty = nobody may.",
        local=True,
    )
    bags: tuple[str, ...] = setting(
        (), "Bags with the samples of stored cycles, to look at two beside each other.", local=True
    )
