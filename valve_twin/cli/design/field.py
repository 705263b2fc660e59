# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design field`: flux linkages, force and inductances at given currents."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.cli.common import OK, add_verb, check_writable, write_file
from valve_twin.cli.design.given import add_design, read_given, refusals, section_of
from valve_twin.cli.output import number, print_json, print_rows, table

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs
    from valve_twin.design.field import Field


def add(steps: Verbs) -> None:
    """Add the step."""
    parser = add_verb(steps, "field", "Compute the static field at given currents.", _field)
    add_design(parser)
    parser.add_argument(
        "--current", nargs="*", type=float, default=[], metavar="A", help="one a coil, in order"
    )
    parser.add_argument(
        "--position", type=float, default=0.0, metavar="M", help="of the armature, default 0"
    )
    add_fine(parser)
    parser.add_argument("--svg", metavar="FILE", help="picture to write")
    parser.add_argument("--json", action="store_true", help="one JSON object")


def add_fine(parser: argparse.ArgumentParser) -> None:
    """Add --fine."""
    parser.add_argument(
        "--fine", type=float, default=1.0, metavar="F", help="elements along a line over the usual"
    )


def _field(arguments: argparse.Namespace) -> int:
    design = read_given(arguments)
    check_writable(arguments.svg)
    from valve_twin.design.field import draw_field, make_model, solve_field

    with refusals(arguments.design):
        model = make_model(section_of(design), arguments.fine)
    with refusals():
        currents = arguments.current or [0.0] * len(model.section.coils)
        found = solve_field(model, currents, arguments.position)
    if arguments.svg:
        write_file(arguments.svg, draw_field(found))
    _show(found, as_json=arguments.json)
    return OK


def _show(found: Field, *, as_json: bool) -> None:
    coils = found.model.section.coils
    values = {f"flux_{name}": (float(found.flux[k]), "Wb") for k, name in enumerate(coils)}
    values |= {"force": (found.force, "N"), "coenergy": (found.coenergy, "J")}
    for k, one in enumerate(coils):
        for m, other in enumerate(coils[: k + 1]):
            values[f"inductance_{one}{other}"] = (float(found.inductance[k, m]), "H")
        values[f"force_slope_{one}"] = (float(found.force_slope[k]), "N/A")
    if as_json:
        sizes: dict[str, float] = {"unknowns": found.model.unknowns, "steps": found.steps}
        print_json({name: value for name, (value, _) in values.items()} | sizes)
        return
    title = f"Field of {found.model.section.name}: {found.model.unknowns} unknowns"
    shown = table(f"{title}, {found.steps} steps", ["value"], [""], ["unit"])
    rows = ((name, number(value, ".6g"), unit) for name, (value, unit) in values.items())
    print_rows(shown, rows)
