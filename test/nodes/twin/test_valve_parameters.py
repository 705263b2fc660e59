# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The parameters of the valves that a node hosts."""

from pathlib import Path

import pytest

from valve_twin.nodes.twin.node import TwinNode
from valve_twin.nodes.twin.valve_parameters import absolute_url


@pytest.mark.parametrize(
    ("url", "absolute"),
    [
        ("h.sqlite", "{}/h.sqlite"),
        ("sqlite:///a/h.sqlite", "sqlite:///{}/a/h.sqlite"),
        ("sqlite:////a/h.sqlite", "sqlite:////a/h.sqlite"),
        ("postgresql://user@host/name", "postgresql://user@host/name"),
        ("sqlite:///:memory:", "sqlite:///:memory:"),
        ("", ""),
    ],
)
def test_a_history_is_named_from_the_root(url, absolute):
    assert absolute_url(url) == absolute.format(Path.cwd())


def test_a_twin_says_where_its_history_lies(graph, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    graph.host(TwinNode, history_url="h.sqlite")
    assert f"history {tmp_path}/h.sqlite" in capfd.readouterr().err
