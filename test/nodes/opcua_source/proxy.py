# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A man in the middle of OPC UA for tests: it hands on questions and harms answers."""

from __future__ import annotations

import socket
import struct
import threading
from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    Harm = Callable[[int, bytes], bytes | None]

HEAD_B = 24
"""Before the body of a chunk: its size, ids of channel and token, its number and request [B]."""


def untouched(number: int, chunk: bytes) -> bytes:
    """Hand on a chunk of the server as it is; its number counts from the connection on."""
    del number
    return chunk


class Proxy:
    """Listens before a server at a port of this machine.

    Attributes
    ----------
    harm : callable
        Gets number and bytes of each chunk that the server sends and returns what the client gets
        instead; None = the connection ends.
    """

    def __init__(self, server_port: int) -> None:
        self.harm: Harm = untouched
        self._to = ("127.0.0.1", server_port)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"opc.tcp://127.0.0.1:{self._listener.getsockname()[1]}"
        self._open: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """End all connections."""
        for one in self._open:
            with suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()
        self._open.clear()

    def close(self) -> None:
        """End all, take no more."""
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self.cut()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                try:
                    server = socket.create_connection(self._to)
                except OSError:
                    client.close()
                    continue
                self._open += [client, server]
                for pump in (self._questions, self._answers):
                    threading.Thread(target=pump, args=(client, server), daemon=True).start()

    def _questions(self, client: socket.socket, server: socket.socket) -> None:
        with suppress(OSError):
            while data := client.recv(65536):
                server.sendall(data)
        with suppress(OSError):
            server.shutdown(socket.SHUT_RDWR)

    def _answers(self, client: socket.socket, server: socket.socket) -> None:
        number = 0
        with suppress(OSError):
            while chunk := _chunk(server):
                harmed = self.harm(number, chunk)
                if harmed is None:
                    break
                client.sendall(harmed)
                number += 1
        with suppress(OSError):
            client.shutdown(socket.SHUT_RDWR)


def _chunk(server: socket.socket) -> bytes:
    """Return the next whole chunk, nothing at the end."""
    data = b""
    size = 8
    while len(data) < size:
        more = server.recv(size - len(data))
        if not more:
            return b""
        data += more
        if len(data) == 8:
            size = struct.unpack_from("<I", data, 4)[0]
    return data
