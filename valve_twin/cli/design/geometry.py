# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design geometry`: restrictions, winding, mass; drawings in DXF and SVG."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.cli.common import OK, add_verb, check_writable, fail, say
from valve_twin.cli.design.given import add_design, read_given, refusals, section_of
from valve_twin.cli.output import number, print_json, print_rows, table
from valve_twin.io.whole import write_all

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs
    from valve_twin.design.geometry import DoubleStroke


def add(steps: Verbs) -> None:
    """Add the step."""
    parser = add_verb(steps, "geometry", "Check a geometry; write its drawing.", _geometry)
    add_design(parser)
    parser.add_argument("--svg", metavar="FILE", help="picture to write")
    parser.add_argument("--dxf", metavar="FILE", help="drawing to write")
    parser.add_argument("--yaml", metavar="FILE", help="all numbers, with what they are")
    parser.add_argument("--json", action="store_true", help="one JSON object")


def _geometry(arguments: argparse.Namespace) -> int:
    from valve_twin.design.geometry import (
        DoubleStroke,
        Section,
        draw_section,
        write_design,
        write_dxf,
    )

    design = read_given(arguments)
    written = [path for path in (arguments.svg, arguments.dxf, arguments.yaml) if path]
    check_writable(*written)
    if isinstance(design, DoubleStroke):
        with refusals():
            broken = design.violations()
        if broken:
            return fail("; ".join(str(violation) for violation in broken))
        _show(design, as_json=arguments.json)
    elif arguments.yaml and isinstance(design, Section):
        return fail("--yaml: writes numbers; a design of kind section has regions")
    with refusals():
        section = section_of(design)
    files: dict[Path, bytes] = {}
    if arguments.svg:
        files[Path(arguments.svg)] = draw_section(section).encode()
    if arguments.dxf:
        write_dxf(section, Path(arguments.dxf), files.__setitem__)
    if arguments.yaml and not isinstance(design, Section):
        write_design(design, Path(arguments.yaml), files.__setitem__)
    write_all(files)
    for path in written:
        say(f"{path}: written")
    return OK


def _show(design: DoubleStroke, *, as_json: bool) -> None:
    winding, wire = design.winding(), design.standard_wire()
    depth = design.window_ratio * design.armature_radius
    values = {
        "layers": (winding.layers, "1"),
        "winding_height": (winding.height, "m"),
        "winding_space": (depth, "m"),
        "overall_wire": (wire.overall, "m"),
        "resistance_20": (winding.resistance, "ohm"),
        "resistance_80": (design.winding(80.0).resistance, "ohm"),
        "working_gap": (design.gap, "m"),
        "stroke": (design.stroke, "m"),
        "armature_mass": (design.armature_mass(), "kg"),
        "moving_mass": (design.moving_mass(), "kg"),
    }
    if as_json:
        print_json({name: value for name, (value, _) in values.items()})
        return
    shown = table("Geometry: every restriction is kept", ["value"], [""], ["unit"])
    rows = ((name, number(value, ".5g"), unit) for name, (value, unit) in values.items())
    print_rows(shown, rows)
