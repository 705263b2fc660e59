# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Designs in YAML."""

from __future__ import annotations

from dataclasses import replace

import pytest
from ezdxf.filemanagement import new

from valve_twin.design.geometry import DoubleStroke, Section, read_design, write_design, write_dxf
from valve_twin.design.materials import Steel

SECTION = """
kind: section
box: {radius: 0.03, low: -0.03, high: 0.03}
materials: {iron: {kind: steel}}
regions:
  - {name: core, material: iron, outline_mm: [[0, 0], [5, 0], [5, 9], [0, 9]]}
"""
TAGGED = ('!!int ""', '!!float ""', "!!bool x", "!!timestamp x", "!!map [a]", "! 300")


def test_what_is_written_is_read_again(tmp_path):
    design = replace(
        DoubleStroke(turns=300, gap_ratio=0.2),
        steel=Steel(table_h=(0.0, 100.0, 1000.0), table_b=(0.0, 1.0, 1.5)),
    )
    write_design(design, tmp_path / "d.yaml")
    text = (tmp_path / "d.yaml").read_text(encoding="utf-8")
    assert (
        "gap_ratio: 0.2  # Working gap in the middle over the armature's radius (assumed)" in text
    )
    assert read_design(tmp_path / "d.yaml") == design


def test_a_number_can_be_replaced():
    found = read_design(None, {"turns": 300, "steel.knee": 500.0})
    assert found == replace(DoubleStroke(turns=300), steel=Steel(knee=500.0))


@pytest.mark.parametrize("text", ["8e-3", "8.0e-3", "0.8E-2", "+8e-3"])
def test_a_number_with_an_exponent_is_one(text, tmp_path):
    path = tmp_path / "d.yaml"
    path.write_text(f"kind: double_stroke\narmature_radius: {text}\n", encoding="utf-8")
    assert read_design(path) == DoubleStroke(armature_radius=8e-3)


def test_the_sample_with_a_magnet_is_a_section(root):
    found = read_design(root / "samples" / "design" / "pot_magnet.yaml")
    assert isinstance(found, Section)
    assert found.coils == ("A",)
    assert found.excited


def test_an_outline_of_a_drawing_that_crosses_itself_is_refused(tmp_path):
    drawing = new("R2010", units=4)
    bowtie = [(0, 0), (5, 9), (5, 0), (0, 12)]
    drawing.modelspace().add_lwpolyline(bowtie, close=True, dxfattribs={"layer": "x"})
    drawing.saveas(tmp_path / "d.dxf")
    text = SECTION.replace("outline_mm: [[0, 0], [5, 0], [5, 9], [0, 9]]", "layer: x")
    (tmp_path / "d.yaml").write_text(f"{text}dxf: d.dxf\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"core: the edge from r = 0, z = 0 to r = 0.005, z = 0"):
        read_design(tmp_path / "d.yaml")


def test_regions_come_from_the_layers_of_a_drawing(tmp_path):
    reference = DoubleStroke().section()
    write_dxf(reference, tmp_path / "d.dxf")
    lines = ["kind: section", "dxf: d.dxf", "box: {radius: 0.04, low: -0.05, high: 0.05}",
             "materials: {steel: {kind: steel}}", "regions:"]  # fmt: skip
    for r in reference.regions:
        more = f", coil: {r.coil}, turns: {r.turns}" if r.coil else ""
        lines.append(f"  - {{name: {r.name}, material: {r.material}, layer: {r.name}{more}}}")
    (tmp_path / "d.yaml").write_text("\n".join(lines), encoding="utf-8")
    found = read_design(tmp_path / "d.yaml")
    assert isinstance(found, Section)
    for one, other in zip(found.regions, reference.regions, strict=True):
        assert (one.name, one.coil, one.turns) == (other.name, other.coil, other.turns)
        for corner, wanted in zip(one.outline, other.outline, strict=True):
            assert corner == pytest.approx(wanted, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("kind: cube", "kind = 'cube': must be double_stroke, hybrid_pole or section"),
        ("[1, 2]", "holds no 'key: value' lines"),
        ("kind: [", "cannot be read"),
        ("kind: " + 5000 * "[", "line 1: nested deeper than 8 levels"),
        ("kind: section  # " + (1 << 18) * "x", "longer than 256 kB, which no design is"),
        ("a: &x [1]\nkind: *x", "line 2: \\*x repeats a value; write it out"),
        ("kind: 2001-99-99", "cannot be read"),
        *((f"kind: hybrid_pole\na: {tagged}", "line 2: a tag, as !!int") for tagged in TAGGED),
        ("kind: double_stroke\nturns: 1" + 400 * "0", "line 2: a number beyond 1e308"),
        ("kind: double_stroke\nturns: 1" + 200 * ":00" + ".0", "line 2: a number beyond 1e308"),
        (
            "kind: double_stroke\ngap_ratio: -1",
            "gap_ratio: value -1.0 is outside its limits; write",
        ),
        ("kind: double_stroke\ngap: 1", "gap: no such number; did you mean 'gap_ratio'"),
        ("kind: double_stroke\nturns: many", "turns: value 'many' is no integer"),
        (SECTION + "  - {name: x}", "x: outline_mm = None: must be a list of"),
        (SECTION + "  - {name: x, layer: y}", "there is no layer 'y'; there are none: give dxf"),
        (SECTION + "  - {name: x, turn: 1}", "'x.turn' is no such key; did you mean 'turns'"),
        ("kind: double_stroke\nturns: 300\nturns: 200", "'turns' stands twice, in lines 2 and 3"),
        ("kind: double_stroke\nturns: 3_00", "line 2: '3_00' is 300 to YAML; write 300"),
        ("kind: double_stroke\nturns: 5:00", "line 2: '5:00' is 300 to YAML"),
        ("[a, b]: 1\nkind: cube", "cannot be read"),
        (SECTION.replace("[5, 9]", "[5, 0x9]"), "line 6: '0x9' is 9 to YAML"),
        (SECTION.replace("[5, 9]", "[5, true]"), "core: outline_mm = .*: must be a list of"),
        (SECTION.replace("material: iron", "material: ~"), "core.material = None: must be a text"),
        (SECTION + "  - {name: x, coil: ~, outline_mm: []}", "x.coil = None: must be a text"),
        (SECTION + "  - {name: x, turns: '1_0', outline_mm: []}", "x: turns = '1_0': must be a n"),
        (SECTION + "color: red", "'color' is no such key"),
        (SECTION.replace("low: -0.03, ", ""), "box.low = None: must be a number"),
        (SECTION.replace("kind: steel", "kind: stone"), "materials.iron.kind = 'stone': must be"),
    ],
)
def test_what_is_wrong_in_a_file_is_one_line_with_the_key(text, words, tmp_path):
    path = tmp_path / "d.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=words) as caught:
        read_design(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
