# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Where the broker is, who we are to it, and what goes there."""

from __future__ import annotations

import ssl
from dataclasses import dataclass
from urllib.parse import urlsplit

from paho.mqtt.client import Client

from valve_twin.io.errors import ConfigError

PORTS = {"mqtt": 1883, "mqtts": 8883}
"""Usual port of each scheme."""


@dataclass(frozen=True, slots=True)
class Message:
    """What goes to the broker.

    Attributes
    ----------
    topic : str
        Where to.
    payload : bytes
        What.
    qos : int
        0 = at most once, 1 = at least once.
    retain : bool
        Whether who subscribes later gets it, too.
    """

    topic: str
    payload: bytes
    qos: int = 0
    retain: bool = False


@dataclass(frozen=True, slots=True)
class Broker:
    """A broker and how to come in.

    Attributes
    ----------
    address : str
        mqtt://HOST[:PORT], or mqtts:// for TLS.
    user, password : str
        Who we are; empty = nobody.
    ca, certificate, key : str
        Files of TLS: who is trusted (empty = who the system trusts), our own pair; empty = none.
    """

    address: str
    user: str = ""
    password: str = ""
    ca: str = ""
    certificate: str = ""
    key: str = ""

    def place(self) -> tuple[str, int]:
        """Return host and port.

        Raises
        ------
        ConfigError
            If the address is none.
        """
        if "@" in self.address:  # not told again: it may hold a password
            msg = "MQTT: an address holds no user: write --mqtt-user and VALVE_TWIN_MQTT_PASSWORD"
            raise ConfigError(msg)
        try:
            parts = urlsplit(self.address)
            if parts.scheme in PORTS and parts.hostname and parts.path in {"", "/"}:
                return parts.hostname, parts.port or PORTS[parts.scheme]
        except ValueError:
            pass
        msg = f"MQTT: '{self.address}' is no address: write mqtt://127.0.0.1:1883 or mqtts://..."
        raise ConfigError(msg)

    def check(self) -> None:
        """Refuse an address or files that are of no use.

        Raises
        ------
        ConfigError
            One line that says which.
        """
        self.place()
        self.apply(Client())

    def apply(self, client: Client) -> None:
        """Give a client what it needs to come in.

        Raises
        ------
        ConfigError
            If a file of TLS cannot be used, or is given for a broker without TLS.
        """
        if self.user:
            client.username_pw_set(self.user, self.password or None)
        files = self.ca, self.certificate, self.key
        if urlsplit(self.address).scheme != "mqtts":
            if any(files):
                msg = f"MQTT: certificates are of no use for {self.address}: write mqtts://"
                raise ConfigError(msg)
            return
        if bool(self.certificate) != bool(self.key):
            msg = "MQTT: our certificate and its key belong together: name both or none"
            raise ConfigError(msg)
        try:
            context = ssl.create_default_context(cafile=self.ca or None)
            if self.certificate:
                context.load_cert_chain(self.certificate, self.key)
        except (OSError, ValueError) as err:
            msg = f"MQTT: {' '.join(f for f in files if f)} cannot be used: {err}"
            raise ConfigError(msg) from err
        client.tls_set_context(context)
