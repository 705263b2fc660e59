# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The standard's nodes from a file are those that asyncua makes."""

from __future__ import annotations

import asyncio

import pytest

pytest.importorskip("asyncua", reason="needs the extra gateway")

from asyncua import Server, ua
from asyncua.server.internal_server import InternalServer

from valve_twin.compat.opcua import nodes_of
from valve_twin.gateway.opcua import standard
from valve_twin.gateway.opcua.standard import Nodes, StandardServer


@pytest.fixture(scope="module")
def made():
    """Return the nodes that asyncua makes."""
    server = InternalServer()
    asyncio.run(server.load_standard_address_space())
    return nodes_of(server)


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """Return a file of them."""
    file = tmp_path_factory.mktemp("standard") / "some.nodes"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(standard, "_FILE", file)
        standard.keep()
    return file


def loaded(monkeypatch, file):
    monkeypatch.setattr(standard, "_FILE", file)
    server = StandardServer()
    asyncio.run(server.load_standard_address_space())
    return nodes_of(server)


def test_every_node_is_that_which_asyncua_makes(monkeypatch, made, kept):
    nodes = loaded(monkeypatch, kept)
    assert isinstance(nodes, Nodes)
    assert list(nodes) == list(made)
    assert len(nodes) > 6000
    for key, node in made.items():
        assert str(nodes[key]) == str(node)


def test_a_node_is_unpacked_once_and_can_be_put_and_taken_away(monkeypatch, kept):
    nodes = loaded(monkeypatch, kept)
    first, second, *_ = nodes
    assert nodes[first] is nodes[first]
    nodes[second] = "other"
    assert nodes[second] == "other"
    del nodes[second]
    assert second not in nodes
    assert nodes.get(second) is None
    assert second not in list(nodes)


@pytest.mark.parametrize("harm", ["missing", "cut", "changed", "of another release"])
def test_nodes_are_made_anew_where_the_file_is_not_what_was(monkeypatch, tmp_path, kept, harm):
    file, whole = tmp_path / "harmed.nodes", kept.read_bytes()
    if harm == "cut":
        file.write_bytes(whole[:-1])
    elif harm == "changed":
        file.write_bytes(whole[:-9] + b"?" + whole[-8:])
    elif harm == "of another release":
        file.write_bytes(whole.replace(b"valve_twin nodes", b"valve_twin nodez", 1))
    assert not isinstance(loaded(monkeypatch, file), Nodes)


def test_a_server_begins_with_few_of_them(monkeypatch, kept):
    """What a start costs grows with the nodes that it unpacks."""
    monkeypatch.setattr(standard, "_FILE", kept)

    async def begun():
        server = Server(StandardServer())
        await server.init()
        root = server.get_node(ua.ObjectIds.RootFolder)
        return nodes_of(server.iserver), await root.get_children()

    nodes, folders = asyncio.run(begun())
    assert len(folders) == 3
    assert isinstance(nodes, Nodes)
    assert nodes.packed > 0.9 * len(nodes)
