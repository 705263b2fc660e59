# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design transient`: the field with eddy currents under a trapezoid of current."""

from __future__ import annotations

from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.cli.common import OK, add_verb, check_writable, say, write_file
from valve_twin.cli.design.given import add_design, read_given, read_map_of, refusals, section_of
from valve_twin.cli.output import print_json
from valve_twin.io.whole import write_whole

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs
    from valve_twin.design.field import Transient

_EVERY = 5  # of the times, one is shown without eddy currents
_SKIN = 1e-3  # size of elements at surfaces where none is given, assumed [m]
_TIMES = (
    ("bias", "current of every coil before and after [A], default 1"),
    ("swing", "of the first coil above and below it [A], default 1"),
    ("slope", "of the flanks [s/A], default 0.004"),
    ("hold", "at each level [s], default 0.004"),
    ("rest", "at the end [s], default 0.005"),
    ("step", "of the computation [s], default 0.0001"),
)


def add(steps: Verbs) -> None:
    """Add the step."""
    text = "Compute the field with eddy currents under a trapezoid of current."
    parser = add_verb(steps, "transient", text, _transient)
    add_design(parser)
    parser.add_argument("--out", required=True, metavar="FILE", help="record to write, .csv")
    parser.add_argument("--svg", metavar="FILE", help="picture to write")
    parser.add_argument("--map", metavar="FILE", help="of the same design: fit G_A and G_F to it")
    for name, about in _TIMES:
        parser.add_argument(f"--{name}", type=float, metavar="N", help=about)
    parser.add_argument("--position", type=float, default=0.0, metavar="M", help="of the armature")
    parser.add_argument("--fine", type=float, default=0.5, metavar="F", help="as of field")
    parser.add_argument(
        "--skin",
        type=float,
        default=_SKIN,
        metavar="M",
        help="elements at surfaces, default 0.001",
    )
    parser.add_argument("--method", choices=("euler", "bdf2"), default="euler")


def _transient(arguments: argparse.Namespace) -> int:
    design = read_given(arguments)
    check_writable(arguments.out, arguments.svg)
    from valve_twin.design.field import Trapezoid, make_model, run_transient, static_force

    names = [f.name for f in fields(Trapezoid)]
    given = {n: getattr(arguments, n) for n in names if getattr(arguments, n) is not None}
    from valve_twin.design.dynamics import identify

    fitted: dict[str, object] = {}
    with refusals():
        curves = read_map_of(arguments.map, design) if arguments.map else None
        shape = Trapezoid(**given)
    with refusals(arguments.design):
        model = make_model(section_of(design), arguments.fine, arguments.skin)
    with refusals():
        time_s, currents = shape.record(len(model.section.coils))
        x = np.full(len(time_s), arguments.position)
        found = run_transient(model, time_s, currents, x, arguments.method)
        if curves is not None:
            both = zip(("G_A", "G_F"), identify(found, curves), strict=True)
            fitted = {name: asdict(dynamics) for name, dynamics in both}
    _write(found, model.section.coils, Path(arguments.out))
    say(f"{arguments.out}: written")
    if arguments.svg:
        from valve_twin.report.transient import draw_transient

        static = static_force(model, currents[::_EVERY], x[::_EVERY])
        picture = draw_transient(
            time_s, currents[:, 0], found.force, (time_s[::_EVERY], static), found.joule
        )
        write_file(arguments.svg, picture)
    heat = float(np.sum(found.joule[1:] * np.diff(time_s)))
    mean = 0.5 * (currents[1:] + currents[:-1])
    given_j = float(np.sum(mean * np.diff(found.flux, axis=0)))
    stored = float(found.energy[-1] - found.energy[0])
    numbers = {
        "unknowns": model.unknowns,
        "times": len(time_s),
        "heat": heat,
        "largest_force": float(found.force.max()),
        "lacks_of_energy": (given_j - stored - heat) / heat if heat else 0.0,
    }
    print_json(numbers | fitted)
    return OK


def _write(found: Transient, coils: tuple[str, ...], path: Path) -> None:
    names = ["time_s", *(f"current_{c}_A" for c in coils), *(f"flux_{c}_Wb" for c in coils)]
    names += ["force_N", "eddy_W"]
    columns = [found.time_s, *found.currents.T, *found.flux.T, found.force, found.joule]
    rows = [",".join(names)]
    rows += [",".join(f"{v:.9g}" for v in row) for row in np.column_stack(columns)]
    write_whole(path, "\n".join(rows) + "\n")
