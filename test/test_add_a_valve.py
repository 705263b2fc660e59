# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""docs/developers/add_a_valve.md builds a valve: its blocks are run as they stand."""

from __future__ import annotations

import importlib
import re
import shlex
import sys
from importlib.metadata import EntryPoint

import pytest

from valve_twin.cli import main
from valve_twin.core.valves import registry
from valve_twin.demo.cases import find_case


def blocks(root, language):
    text = (root / "docs" / "developers" / "add_a_valve.md").read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, flags=re.DOTALL | re.MULTILINE)


@pytest.fixture
def valve(root, tmp_path, monkeypatch):
    """The valve of the page, registered by the entry point of the page."""
    file = tmp_path / "my_valve.py"
    file.write_text("\n".join(blocks(root, "python")), encoding="utf-8")
    (config,) = blocks(root, "yaml")
    (tmp_path / "my_valve.yaml").write_text(config, encoding="utf-8")
    (toml,) = blocks(root, "toml")
    name, value = re.findall(r'^(\w+) = "(.*)"$', toml, flags=re.MULTILINE)[0]
    monkeypatch.syspath_prepend(tmp_path)
    module = importlib.import_module("my_valve")
    entry = EntryPoint(name, value, registry.ENTRY_POINT_GROUP)
    monkeypatch.setattr(registry, "entry_points", lambda group: [entry])
    monkeypatch.chdir(tmp_path)
    yield module.VALVE
    registry.get_model.cache_clear()
    sys.modules.pop("my_valve")


def test_the_valve_of_the_page_keeps_the_protocol_and_runs(root, valve, tmp_path, capsys):
    assert registry.get_model("my_valve") is valve
    commands = [line for block in blocks(root, "sh") for line in block.splitlines()]
    assert len(commands) == 4
    for command in commands:
        program, *arguments = shlex.split(command)
        assert program == "valve-twin"
        assert main(arguments) == 0, command
    out = capsys.readouterr().out
    assert "FAIL" not in out
    assert '"time_constant"' in out
    assert "time_constant" in (tmp_path / "my_valve.html").read_text(encoding="utf-8")


def test_the_valve_of_the_page_is_shown_by_the_demo(valve, tmp_path):
    case = find_case(file=tmp_path / "my_valve.yaml")
    assert (case.model, case.followed) == (valve.name, "time_constant")
    assert find_case("my_valve", file=tmp_path / "my_valve.yaml") == case


def test_the_page_ends_in_one_file_of_about_45_lines(root):
    lines = [line for block in blocks(root, "python") for line in block.splitlines()]
    assert len([line for line in lines if line.strip()]) <= 45
