# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The 6000 nodes that every server of OPC UA has, kept from an installation and unpacked on use.

asyncua makes them anew at each start from code, 0.5 s of CPU, and its own shelf of them lists only
those that were used. Here each is packed by itself in one file beside this module, made by
`python -m valve_twin.warmup`; where there is none, or another release's, they are made anew.
"""

from __future__ import annotations

import asyncio
import pickle
import sys
from collections.abc import Iterator, MutableMapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import asyncua
from asyncua import ua
from asyncua.server.internal_server import InternalServer

from valve_twin.compat.opcua import nodes_of, set_nodes
from valve_twin.io.sealed import unsealed_bytes, write_sealed

if TYPE_CHECKING:
    from asyncua.server.address_space import NodeData

_MAGIC = f"valve_twin nodes {asyncua.__version__} {sys.hexversion:x} ".encode()
_FILE = Path(__file__).parent / "__pycache__" / f"standard.{sys.implementation.cache_tag}.nodes"


class Nodes(MutableMapping[ua.NodeId, "NodeData"]):
    """Nodes by their ids, in the order in which they were made.

    Parameters
    ----------
    packed : dict of NodeId to bytes
        Those that are unpacked when they are asked for.
    """

    def __init__(self, packed: dict[ua.NodeId, bytes]) -> None:
        self._packed = packed
        self._nodes: dict[ua.NodeId, NodeData | None] = dict.fromkeys(packed)

    @property
    def packed(self) -> int:
        """How many were never asked for."""
        return len(self._packed)

    def __getitem__(self, key: ua.NodeId) -> NodeData:
        """Return a node, the same one each time."""
        node = self._nodes[key]
        if node is None:
            node = self._nodes[key] = pickle.loads(self._packed.pop(key))
        return node

    def __contains__(self, key: object) -> bool:
        """Return whether there is a node, without unpacking it."""
        return key in self._nodes

    def __setitem__(self, key: ua.NodeId, node: NodeData) -> None:
        """Take a node."""
        self._packed.pop(key, None)
        self._nodes[key] = node

    def __delitem__(self, key: ua.NodeId) -> None:
        """Forget a node."""
        self._packed.pop(key, None)
        del self._nodes[key]

    def __iter__(self) -> Iterator[ua.NodeId]:
        """Return the ids of all nodes."""
        return iter(self._nodes)

    def __len__(self) -> int:
        """Return how many nodes there are."""
        return len(self._nodes)


class StandardServer(InternalServer):  # type: ignore[misc]
    """asyncua's inner server with the nodes of the file."""

    async def load_standard_address_space(self, shelf_file: Path | None = None) -> None:
        """Take the standard's nodes from the file, else have them made."""
        packed = _read(_FILE)
        if packed is None:
            await super().load_standard_address_space(shelf_file)
        else:
            set_nodes(self, Nodes(packed))


def keep() -> None:
    """Make the file; where the folder takes none, a server makes the nodes at each start."""
    server = InternalServer()
    asyncio.run(server.load_standard_address_space())
    nodes = [(key.Identifier, pickle.dumps(node, 5)) for key, node in nodes_of(server).items()]
    with suppress(OSError):
        _FILE.parent.mkdir(exist_ok=True)
        write_sealed(_FILE, _FILE.with_suffix(".part"), _MAGIC, pickle.dumps(nodes, 5))


def _read(path: Path) -> dict[ua.NodeId, bytes] | None:
    """Return what is packed; None where it is missing, damaged or of other releases."""
    try:
        content = unsealed_bytes(_MAGIC, path.read_bytes())
    except OSError:
        return None
    if content is None:
        return None
    return {ua.NodeId(identifier): node for identifier, node in pickle.loads(content)}
