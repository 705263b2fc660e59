# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The shipped layouts are those of today's messages."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import pytest

from valve_twin.core.valves.registry import DEFAULT_MODEL, get_model
from valve_twin.report.layouts import (
    Curve,
    Plot,
    Tab,
    check,
    foxglove,
    numeric_fields,
    plotjuggler,
    read_definitions,
    tabs,
    write_layouts,
)

if TYPE_CHECKING:
    from pathlib import Path

MODEL = get_model(DEFAULT_MODEL)


@pytest.mark.parametrize("name", ["plotjuggler.xml", "foxglove.json"])
def test_shipped_layout_is_what_the_messages_give(name: str, root: Path, tmp_path: Path) -> None:
    write_layouts(root / "msg_defs" / "msg", tmp_path)
    shipped = (root / "layouts" / name).read_text(encoding="utf-8")
    remedy = "python -m valve_twin.report.layouts msg_defs/msg layouts"
    assert (tmp_path / name).read_text(encoding="utf-8") == shipped, f"run: {remedy}"


def test_the_layout_of_another_valve_shows_its_own_commands_and_trends() -> None:
    model = get_model("positioner")
    pages = tabs(model)
    assert [c.topic for c in pages[0].plots[2].curves] == [f"command/{n}" for n in model.inputs]
    assert [page.title for page in pages[2:]] == [p.name for p in model.parameters if p.trend]


def test_a_renamed_field_stops_the_generation(root: Path, tmp_path: Path) -> None:
    for file in (root / "msg_defs" / "msg").glob("*.msg"):
        text = file.read_text(encoding="utf-8").replace("float64 simulated", "float64 free_run")
        (tmp_path / file.name).write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=r"Prediction has no numeric field 'simulated'.*free_run"):
        write_layouts(tmp_path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_missing_message_stops_the_generation() -> None:
    page = Tab("Cycle", (Plot("p", (Curve("Nothing", "t", "x"),)),))
    with pytest.raises(ValueError, match="'Cycle': there is no message Nothing"):
        check([page], {})


def test_only_single_numbers_can_be_plotted() -> None:
    text = (
        "# float64 commented 1\nuint8 OK=0  # constant\nstd_msgs/Header header\nstring valve\n"
        "float64 fit_test # [%]\nfloat64[] values\nuint32[3] three\nbool stored\n  int32 lag\n"
        "string<=8 short\n"
    )
    assert numeric_fields(text) == {"fit_test", "stored", "lag"}


def test_every_curve_is_on_a_topic_of_the_valve_in_both_viewers(root: Path) -> None:
    pages = tabs(MODEL)
    wanted = [c for page in pages for p in page.plots for c in p.curves]
    wanted += [c for page in pages for c in page.states]
    xml = ET.fromstring(plotjuggler(pages, "/mill/v7"))
    names = [curve.get("name") for curve in xml.iter("curve")]
    assert sorted(map(str, names)) == sorted(f"/mill/v7/{c.topic}/{c.field}" for c in wanted)
    panels = json.loads(foxglove(pages, "/mill/v7"))["configById"]
    paths = [path["value"] for panel in panels.values() for path in panel.get("paths", [])]
    assert sorted(paths) == sorted(f"/mill/v7/{c.topic}.{c.field}" for c in wanted)
    assert {c.message for c in wanted} <= set(read_definitions(root / "msg_defs" / "msg"))


def test_foxglove_shows_every_panel_once(root: Path) -> None:
    layout = json.loads(foxglove(tabs(MODEL), "/mill/v7"))

    def leaves(node: object) -> list[str]:
        if isinstance(node, dict):
            return leaves(node["first"]) + leaves(node["second"])
        return [str(node)]

    inside = [
        name for tab in layout["configById"]["Tab!pages"]["tabs"] for name in leaves(tab["layout"])
    ]
    assert sorted(inside + leaves(layout["layout"])) == sorted(layout["configById"])
