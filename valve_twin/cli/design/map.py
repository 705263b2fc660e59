# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design map`: the characteristic map of a solenoid, as a file and a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.cli.common import OK, add_verb, check_writable, progress_of, say, write_file
from valve_twin.cli.design.given import add_design, grid_of, read_given, refusals, section_of
from valve_twin.cli.output import print_json
from valve_twin.io.whole import write_whole

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs


def add(steps: Verbs) -> None:
    """Add the step."""
    parser = add_verb(steps, "map", "Compute the map of flux linkages and force.", _map)
    add_design(parser)
    parser.add_argument("--out", required=True, metavar="FILE", help="map to write, .npz")
    parser.add_argument("--svg", metavar="FILE", help="picture to write")
    for name, kind, text in (
        ("largest_current", float, "of each coil [A], default 3 or what valve.power allows"),
        ("currents", int, "currents of each coil, default 7"),
        ("positions", int, "positions over the stroke, default 9"),
        ("fine", float, "elements along a line over the usual, default 0.8"),
    ):
        parser.add_argument(f"--{name.replace('_', '-')}", type=kind, metavar="N", help=text)


def _map(arguments: argparse.Namespace) -> int:
    design = read_given(arguments)
    check_writable(arguments.out, arguments.svg)
    from valve_twin.core.physics.coenergy import check_inductances
    from valve_twin.design.map import compute_map, write_map

    names = ("largest_current", "currents", "positions", "fine")
    given = {n: getattr(arguments, n) for n in names if getattr(arguments, n) is not None}
    with refusals():
        grid = grid_of(design, given)
    with refusals(arguments.design):
        section = section_of(design)
        with progress_of("computing fields", None) as advance:
            found = compute_map(section, grid, advance)
    write_map(found, Path(arguments.out), write_whole)
    say(f"{arguments.out}: written")
    if arguments.svg:
        from valve_twin.report.coenergy import draw_coenergy

        write_file(arguments.svg, draw_coenergy(found))
    said = ("name", "unknowns", "fields", "newton_steps", "sha256")
    print_json(
        {name: found.provenance[name] for name in said}
        | {"least_inductance": check_inductances(found)}
    )
    return OK
