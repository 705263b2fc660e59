# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Parameters of the gateway beside those of the valve."""

from __future__ import annotations

from dataclasses import dataclass

from valve_twin.core.quantity import quantity, setting
from valve_twin.io.config.every_node import NodeParameters


@dataclass(frozen=True, slots=True)
class GatewayParameters(NodeParameters):
    """Parameters of the gateway."""

    host: str = setting(
        "127.0.0.1", "Address to listen at; 127.0.0.1 = this machine only.", local=True
    )
    port: int = quantity(8107, "1", "TCP port; 0 = any that is free.", lower=0, upper=65535)
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
