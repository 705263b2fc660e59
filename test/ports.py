# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Ports for servers that a test starts, and starts again."""

from __future__ import annotations

import socket

_held: list[socket.socket] = []


def free_port() -> int:
    """Return a port of this machine that nobody else is given until this process ends.

    It stays bound here without listening: a server may listen there, as one that was killed may
    again, while no other test is given the port, nor does who connects get it as his own.
    """
    held = socket.socket()
    held.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    held.bind(("127.0.0.1", 0))
    _held.append(held)
    return int(held.getsockname()[1])
