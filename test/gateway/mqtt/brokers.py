# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Brokers by others in processes of their own, amqtt and mosquitto, and who listens to them."""

from __future__ import annotations

import ipaddress
import shutil
import socket
import ssl
import subprocess
import sys
import time
from dataclasses import dataclass, field
from datetime import datetime, timedelta, timezone
from typing import TYPE_CHECKING, Any

import pytest
import yaml
from paho.mqtt.client import Client
from pysparkplug import DBirth, DData, DDeath, NBirth, NData, NDeath

from test.ports import free_port

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

GROUP, NODE = "plant", "hall 1"
KINDS: dict[str, Any] = {
    "NBIRTH": NBirth,
    "DBIRTH": DBirth,
    "NDATA": NData,
    "DDATA": DData,
    "NDEATH": NDeath,
    "DDEATH": DDeath,
}
LIMIT_S = 60.0
USER, PASSWORD = "anna", "right"
SBIN = "/usr/sbin"
"""Where Debian has mosquitto, outside the path of a user."""


def wait_until(found: Callable[[], object], what: str) -> None:
    end = time.monotonic() + LIMIT_S
    while not found():
        assert time.monotonic() < end, f"{what} within {LIMIT_S:g} s"
        time.sleep(0.05)  # polls; nothing depends on the length


@dataclass(frozen=True)
class Pair:
    """A certificate for this machine by an authority of its own; files."""

    ca: Path
    certificate: Path
    key: Path


def make_pair(folder: Path) -> Pair:
    """Write an authority and a certificate of it for 127.0.0.1, good for an hour."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import NameOID

    def name(text: str) -> x509.Name:
        return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])

    now = datetime.now(timezone.utc)
    root, own = ec.generate_private_key(ec.SECP256R1()), ec.generate_private_key(ec.SECP256R1())
    common = x509.CertificateBuilder().issuer_name(name("authority"))
    common = common.not_valid_before(now - timedelta(hours=1))
    common = common.not_valid_after(now + timedelta(hours=1))
    authority = (
        common.subject_name(name("authority"))
        .public_key(root.public_key())
        .serial_number(1)
        .add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
        .sign(root, hashes.SHA256())
    )
    here = x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))])
    certificate = (
        common.subject_name(name("broker"))
        .public_key(own.public_key())
        .serial_number(2)
        .add_extension(here, critical=False)
        .sign(root, hashes.SHA256())
    )
    made = Pair(folder / "ca.pem", folder / "broker.pem", folder / "broker.key")
    made.ca.write_bytes(authority.public_bytes(serialization.Encoding.PEM))
    made.certificate.write_bytes(certificate.public_bytes(serialization.Encoding.PEM))
    made.key.write_bytes(
        own.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        )
    )
    return made


class Broker:
    """amqtt, at the same port after each start.

    Parameters
    ----------
    folder : Path
        For its files.
    guarded : bool
        Whether USER needs PASSWORD and anybody else stays out.
    pair : Pair, optional
        Of TLS.
    """

    def __init__(self, folder: Path, guarded: bool = False, pair: Pair | None = None) -> None:
        self.port, self.guarded, self.pair = free_port(), guarded, pair
        self.address = f"mqtt{'s' if pair else ''}://127.0.0.1:{self.port}"
        self._command = self.configured(folder)
        self.start()

    def configured(self, folder: Path) -> list[str]:
        """Write its configuration; return how it is started."""
        from pwdlib import PasswordHash

        plugins: dict[str, Any] = {
            "amqtt.plugins.authentication.AnonymousAuthPlugin": {
                "allow_anonymous": not self.guarded
            }
        }
        if self.guarded:
            users = folder / "users"
            users.write_text(f"{USER}:{PasswordHash.recommended().hash(PASSWORD)}\n")
            file = {"password_file": str(users)}
            plugins["amqtt.plugins.authentication.FileAuthPlugin"] = file
        where: dict[str, Any] = {"type": "tcp", "bind": f"127.0.0.1:{self.port}"}
        if self.pair is not None:
            files = {"certfile": str(self.pair.certificate), "keyfile": str(self.pair.key)}
            where |= {"ssl": True, **files}
        config = folder / f"broker_{self.port}.yaml"
        config.write_text(yaml.safe_dump({"listeners": {"default": where}, "plugins": plugins}))
        return [sys.executable, "-m", "amqtt.scripts.broker_script", "-c", str(config)]

    def start(self) -> None:
        self.process = subprocess.Popen(
            self._command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        wait_until(self._listens, "a broker")

    def kill(self) -> None:
        self.process.kill()
        self.process.wait(30)

    def _listens(self) -> bool:
        assert self.process.poll() is None
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0


class Mosquitto(Broker):
    """mosquitto, where this machine has it."""

    def configured(self, folder: Path) -> list[str]:
        """Write its configuration; return how it is started."""
        program, passwords = found_program("mosquitto"), found_program("mosquitto_passwd")
        lines = [f"listener {self.port} 127.0.0.1", "persistence false", "user root"]
        lines.append(f"allow_anonymous {'false' if self.guarded else 'true'}")
        if self.guarded:
            users = folder / "mosquitto_users"
            subprocess.run([passwords, "-b", "-c", users, USER, PASSWORD], check=True)
            lines.append(f"password_file {users}")
        if self.pair is not None:
            lines += [f"certfile {self.pair.certificate}", f"keyfile {self.pair.key}"]
        config = folder / "mosquitto.conf"
        config.write_text("\n".join([*lines, ""]))
        return [program, "-c", str(config)]


def found_program(name: str) -> str:
    """Return the path of a program; the test is skipped where there is none."""
    found = shutil.which(name) or shutil.which(name, path=SBIN)
    if found is None:
        pytest.skip(f"{name} is not on this machine: sudo apt install mosquitto")
    return found


@dataclass
class Heard:
    """A message of Sparkplug as a host application sees it."""

    kind: str
    device: str
    payload: Any
    values: dict[str, Any] = field(init=False)
    kinds: dict[str, Any] = field(init=False)

    def __post_init__(self) -> None:
        metrics = getattr(self.payload, "metrics", ())
        self.values = {m.name: m.value for m in metrics}
        self.kinds = {m.name: m.datatype for m in metrics}


class Listener:
    """Hears everything; connects again by itself."""

    def __init__(self, broker: Broker) -> None:
        self.raw: list[tuple[str, bytes, bool]] = []
        self._there = False
        self.client = Client()
        self.client.on_connect = lambda client, *_: client.subscribe("#", 1)
        self.client.on_subscribe = lambda *_: setattr(self, "_there", True)
        self.client.on_disconnect = lambda *_: setattr(self, "_there", False)
        self.client.on_message = lambda _c, _u, m: self.raw.append((m.topic, m.payload, m.retain))
        self.client.reconnect_delay_set(1, 1)
        if broker.guarded:
            self.client.username_pw_set(USER, PASSWORD)
        if broker.pair is not None:
            self.client.tls_set_context(ssl.create_default_context(cafile=broker.pair.ca))
        self.client.connect("127.0.0.1", broker.port, 5)
        self.client.loop_start()
        self.wait_there()

    def wait_gone(self) -> None:
        wait_until(lambda: not self._there, "a listener that knows of the outage")

    def wait_there(self) -> None:
        wait_until(lambda: self._there, "a connected listener")

    @property
    def heard(self) -> list[Heard]:
        found = []
        for topic, payload, _ in list(self.raw):
            parts = topic.split("/")
            if parts[0] == "spBv1.0" and parts[1] == GROUP and parts[2] in KINDS:
                device = parts[4] if len(parts) > 4 else ""
                found.append(Heard(parts[2], device, KINDS[parts[2]].decode(payload)))
        return found

    def of(self, kind: str, device: str = "") -> list[Heard]:
        return [h for h in self.heard if h.kind == kind and h.device == device]

    def cycles(self, device: str) -> list[tuple[int, bool]]:
        """Return number and whether it is history of all stored cycles heard of a device."""
        return [
            (m.value, m.is_historical)
            for h in self.of("DDATA", device)
            for m in h.payload.metrics
            if m.name == "cycles/cycle"
        ]

    def end(self) -> None:
        self.client.disconnect()
        self.client.loop_stop()
