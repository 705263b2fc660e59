# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The socket that the pages are served at: its address, its certificate, and a server on it."""

from __future__ import annotations

import ipaddress
import socket
import ssl
import threading
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from valve_twin.gateway.descriptors import BoundedListener, leave_unsaid, raise_descriptors
from valve_twin.io.errors import ConfigError

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable

    from starlette.applications import Starlette

FAREWELL_S = 1.0
"""Viewers get so long to go when the server ends [s]."""

IDLE_S = 10.0
"""Who is connected and asks nothing whole, or takes nothing of an answer, goes after one to two
times as long [s]."""

MOST_CONNECTIONS = 500
"""Connections at a time; more are answered 503, those beyond twice as many are let go at once, or
beyond half of the descriptors that the process has [1]."""

_MOST_PORT = 65535


@dataclass(frozen=True, slots=True)
class Place:
    """Where the pages are served.

    Attributes
    ----------
    host, port : str, int
        Address to listen at; port 0 = any that is free.
    certificate, key : str
        Files (PEM) for TLS; both empty = without.
    """

    host: str = "127.0.0.1"
    port: int = 8107
    certificate: str = ""
    key: str = ""

    @property
    def secure(self) -> bool:
        """Whether TLS is spoken."""
        return bool(self.certificate)

    @property
    def local(self) -> bool:
        """Whether nobody on another machine can reach it."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"


def check_place(place: Place, *, accounts: bool) -> str:
    """Return what the user is to be told of a place; empty where nothing.

    Parameters
    ----------
    place : Place
        Where the pages are to be served.
    accounts : bool
        Whether passwords are sent there.

    Raises
    ------
    ConfigError
        If it cannot be, in one line.
    """
    if not 0 <= place.port <= _MOST_PORT:
        msg = f"port {place.port} is not in 0 .. {_MOST_PORT}"
        raise ConfigError(msg)
    if bool(place.certificate) != bool(place.key):
        missing = "key" if place.certificate else "certificate"
        msg = f"TLS needs a certificate and its key: the {missing} is missing"
        raise ConfigError(msg)
    if place.secure:
        check_pair(place.certificate, place.key)
    if place.local or place.secure:
        return ""
    if accounts:
        msg = (
            f"{place.host} can be reached from other machines and passwords would go there in "
            "the clear: give a certificate and its key, or listen at 127.0.0.1"
        )
        raise ConfigError(msg)
    return f"{place.host} can be reached from other machines, without TLS: anybody may look on"


def check_pair(certificate: str, key: str) -> None:
    """Refuse a certificate that browsers would, or that its key does not fit.

    Raises
    ------
    ConfigError
        One line that names the file.
    """
    from cryptography import x509

    for path in (certificate, key):
        try:
            content = Path(path).read_bytes()
        except OSError as err:
            msg = f"{path}: cannot be read: {err.strerror or err}"
            raise ConfigError(msg) from err
        if path == certificate:
            try:
                found = x509.load_pem_x509_certificate(content)
            except ValueError as err:
                msg = f"{path}: is no certificate (PEM)"
                raise ConfigError(msg) from err
    begin, end = found.not_valid_before_utc, found.not_valid_after_utc
    if not begin <= datetime.now(timezone.utc) <= end:
        msg = f"{certificate}: holds from {begin:%Y-%m-%d} to {end:%Y-%m-%d}: put a new one there"
        raise ConfigError(msg)
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(
            certificate, key, password=_no_password
        )
    except (ssl.SSLError, ValueError) as err:
        msg = (
            f"{key}: is no key without a password (PEM) that fits {certificate}: put the right "
            "pair there"
        )
        raise ConfigError(msg) from err


def _no_password() -> str:
    return ""


def listen(place: Place) -> socket.socket:
    """Return a socket that listens; it leaves descriptors to the history and the other faces.

    Raises
    ------
    ConfigError
        If that cannot be, in one line.
    """
    family = socket.AF_INET6 if ":" in place.host else socket.AF_INET
    listening = BoundedListener(family)
    listening.most = min(2 * MOST_CONNECTIONS, raise_descriptors() // 2)
    leave_unsaid()
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((place.host, place.port))
        listening.listen(128)  # who asks before the server has started waits for it
    except OSError as err:
        listening.close()
        where = f"{place.host}:{place.port}"
        msg = f"cannot listen at {where}: {err.strerror or err}: choose another port or host"
        raise ConfigError(msg) from err
    return listening


def address(place: Place, listening: socket.socket) -> str:
    """Return the address of the pages."""
    host, port = listening.getsockname()[:2]
    shown = f"[{host}]" if ":" in host else host
    return f"http{'s' if place.secure else ''}://{shown}:{port}/"


def _impatient() -> type:
    """Return the protocol of uvicorn that lets idle connections go: else 500 of them fill it."""
    from uvicorn.protocols.http.h11_impl import H11Protocol

    class Impatient(H11Protocol):
        """Looks at its connection now and then."""

        _seen: object = None

        def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
            super().connection_made(transport)
            self.loop.call_later(IDLE_S, self._look)

        def _look(self) -> None:
            if self.transport.is_closing():
                return
            now = self._hindered()
            if now is not None and now == self._seen:
                self.transport.abort()
                return
            self._seen = now
            self.loop.call_later(IDLE_S, self._look)

        def _hindered(self) -> object:
            """Return what its client keeps waiting for; None where it is not the client."""
            cycle: Any = self.cycle
            unread = self.transport.get_write_buffer_size()
            if unread:
                return "unread", unread
            if cycle is None or cycle.response_complete:
                return "nothing asked", cycle  # itself: the next could get its address
            return ("half asked", len(cycle.body)) if cycle.more_body else None

    return Impatient


def make_server(application: Starlette, place: Place) -> Any:  # noqa: ANN401 - of uvicorn
    """Return a server of uvicorn; `run(sockets=[...])` serves until `should_exit`."""
    import uvicorn

    config = uvicorn.Config(
        application,
        loop="asyncio",  # uvloop, where it is installed, accepts without asking our listener
        log_level="critical",  # what a client does wrong is no line of ours
        access_log=False,
        server_header=False,
        lifespan="off",
        http=_impatient(),
        limit_concurrency=MOST_CONNECTIONS,
        timeout_graceful_shutdown=max(1, round(FAREWELL_S)),
        ssl_certfile=place.certificate or None,
        ssl_keyfile=place.key or None,
    )
    return uvicorn.Server(config)


class Background:
    """A server on a thread of its own.

    Parameters
    ----------
    application : Starlette
        What is served.
    place : Place
        Where; checked before.
    tell : callable
        Gets a line where the server ends of itself.
    """

    def __init__(self, application: Starlette, place: Place, tell: Callable[[str], None]) -> None:
        self._tell = tell
        self._socket = listen(place)
        self.address = address(place, self._socket)
        self._server = make_server(application, place)
        self._thread = threading.Thread(target=self._run, name="pages", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End it."""
        self._server.should_exit = True
        self._thread.join(FAREWELL_S + 2.0)
        self._socket.close()

    def _run(self) -> None:
        try:
            self._server.run(sockets=[self._socket])
        except Exception as err:
            self._tell(f"the pages are not served any more: {type(err).__name__}: {err}")
