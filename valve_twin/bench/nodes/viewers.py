# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Viewers of moving plots as a program of its own: host, port and the path of each."""

from __future__ import annotations

import asyncio
import sys


async def look(host: str, port: int, path: str) -> None:
    """Read what a moving plot is told until the process is ended."""
    reader, writer = await asyncio.open_connection(host, port)
    writer.write(f"GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
    while await reader.read(1 << 16):
        pass


async def main(host: str, port: int, paths: list[str]) -> None:
    """Look at all."""
    await asyncio.gather(*(look(host, port, path) for path in paths))


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], int(sys.argv[2]), sys.argv[3:]))
