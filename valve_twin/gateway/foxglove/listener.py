# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The port of Foxglove: opened anew where the library has closed it for want of descriptors."""

from __future__ import annotations

import logging
import socket
import time
from typing import TYPE_CHECKING

import foxglove

from valve_twin.gateway.descriptors import out_of_descriptors
from valve_twin.io.errors import ConfigError

if TYPE_CHECKING:
    from foxglove import Context
    from foxglove.websocket import ServerListener, WebSocketServer

EVERY_S = 2.0
"""Whether anybody listens is asked so often [s]."""

TELL_S = 60.0
"""That nobody did is told so often at most [s]."""

MOST_WAITING = 4096
"""Messages that wait for a client; of one that does not read, the oldest are dropped [1]."""

_PATIENCE_S = 3.0
"""A connection to ourselves that takes longer waits behind others: somebody listens [s]."""

_MANY = 2
"""A port that is refused so often in a row is told [1]."""

_LOGGER = logging.getLogger("valve_twin")


class Listener:
    """Serves the channels of a context.

    foxglove-sdk 0.30 listens no more, for good and without a word, once the process has no
    descriptor left for a connection: some thousand connections at a time did that.

    Parameters
    ----------
    context : Context
        Holds the channels.
    subscriptions : ServerListener
        Is told what clients do.
    host : str
        Address to listen at.
    port : int
        TCP port; 0 = any.
    """

    def __init__(
        self, context: Context, subscriptions: ServerListener, host: str, port: int
    ) -> None:
        self._context, self._subscriptions = context, subscriptions
        self._host, self._port = host, port
        self._server: WebSocketServer | None = None
        self._due_s = self._tell_s = 0.0
        self._refused = 0

    def start(self) -> str:
        """Listen; return the address.

        Raises
        ------
        ConfigError
            If that is not possible.
        """
        try:
            self._open()
        except (OSError, RuntimeError) as err:
            where = f"{self._host}:{self._port}"
            msg = f"Foxglove: cannot listen at {where}: {err}: choose another port"
            raise ConfigError(msg) from err
        host = f"[{self._host}]" if ":" in self._host else self._host
        return f"ws://{host}:{self._port}"

    def look(self) -> None:
        """Now and then see whether somebody listens; else let all clients go and listen anew."""
        now_s = time.monotonic()
        if now_s < self._due_s:
            return
        self._due_s = now_s + EVERY_S
        if self._server is not None and self._listens():
            return
        if self._server is not None and now_s >= self._tell_s:
            self._tell_s = now_s + TELL_S
            self._tell("too many connections: all clients were let go, it listens anew")
        self.stop()
        try:
            self._open()
        except (OSError, RuntimeError) as err:  # tried again: another process has the port, say
            self._refused += 1
            if self._refused == _MANY:  # else our own port was not free at once
                self._tell(f"cannot listen: {err}; tried again")
            return
        if self._refused >= _MANY:
            self._tell("listens again")
        self._refused = 0

    def _tell(self, text: str) -> None:
        _LOGGER.warning("Foxglove at %s:%d: %s", self._host, self._port, text)

    def stop(self) -> None:
        """Listen no more."""
        if self._server is not None:
            self._server.stop()
            self._server = None

    def _open(self) -> None:
        self._server = foxglove.start_server(
            name="valve_twin",
            host=self._host,
            port=self._port,
            context=self._context,
            server_listener=self._subscriptions,
            message_backlog_size=MOST_WAITING,
        )
        self._port = self._server.port

    def _listens(self) -> bool:
        """Return whether a connection to ourselves is taken."""
        own = {"0.0.0.0": "127.0.0.1", "::": "::1", "": "127.0.0.1"}.get(self._host, self._host)
        try:
            socket.create_connection((own, self._port), _PATIENCE_S).close()
        except ConnectionRefusedError:
            return False
        except OSError as err:
            return not out_of_descriptors(err)
        return True
