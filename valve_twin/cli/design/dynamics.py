# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design dynamics`: G_A and G_F from a flux that the bridge can make, and branches."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

from valve_twin.cli.common import OK, add_verb, check_writable, progress_of, say, write_file
from valve_twin.cli.design.given import add_design, read_double_stroke, read_map_of, refusals
from valve_twin.cli.output import print_json

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs
    from valve_twin.design.dynamics import Branches, Switched


def add(steps: Verbs) -> None:
    """Add the step."""
    text = "Fit G_A and G_F to a trapezoid whose flux switched voltages can make."
    parser = add_verb(steps, "dynamics", text, _dynamics)
    add_design(parser)
    parser.add_argument("--map", metavar="FILE", help="map of the same design; default: computed")
    parser.add_argument("--svg", metavar="FILE", help="picture to write")
    parser.add_argument(
        "--slope", type=float, default=1e-3, metavar="N",
        help="of the first try's flanks [s/A], default 0.001; made longer where it is too steep",
    )  # fmt: skip
    parser.add_argument(
        "--criterion", choices=("interval", "end"), default="interval",
        help="which pattern is taken: least error over a sample (the paper's), or at its end",
    )  # fmt: skip
    parser.add_argument(
        "--fidelity", default="usual", metavar="NAME", help="fields, as of evaluate"
    )


def _dynamics(arguments: argparse.Namespace) -> int:
    design = read_double_stroke(arguments)
    check_writable(arguments.svg)
    from valve_twin.design.chain import find_fidelity
    from valve_twin.design.dynamics import Bridge, branch_records, fit_branches, identify_switched
    from valve_twin.design.field import Trapezoid, make_model
    from valve_twin.design.map import compute_map

    with refusals():
        of, shape = find_fidelity(arguments.fidelity), Trapezoid(slope=arguments.slope)
        section = design.section()
        if arguments.map:
            curves = read_map_of(arguments.map, design)
        else:
            with progress_of("computing fields", None) as advance:
                curves = compute_map(section, of.grid, advance)
        model = make_model(section, of.fine, of.skin)
        bridge = Bridge(design.winding().resistance, design.valve.supply)
        found = identify_switched(model, curves, bridge, shape, arguments.criterion)
        branches = fit_branches(branch_records(model, of.step), curves)
    if arguments.svg:
        from valve_twin.report.transient import draw_switched

        record = found.found
        signals = record.flux[:, 0], record.currents[:, 0], record.force
        switched = found.rebuilt.flux, found.static
        picture = draw_switched(record.time_s, signals, switched, bridge.resistance)
        write_file(arguments.svg, picture)
    if not found.reached:
        say(
            f"slope {found.shape.slope:g} s/A is still too steep: the flux is off by "
            f"{found.rebuilt.largest:.3g} Wb, allowed {bridge.limit:.3g}; take a larger --slope"
        )
    print_json(_as_json(found, branches, bridge.limit))
    return OK


def _as_json(found: Switched, branches: Branches, limit: float) -> dict[str, object]:
    each = {"G_A": found.of_current, "G_A_smooth": found.smooth, "G_F": found.of_force}
    return {
        "slope": found.shape.slope,
        "tries": found.tries,
        "reached": found.reached,
        "flux_error": found.rebuilt.largest,
        "flux_error_allowed": limit,
        "flux_fit": found.rebuilt.fit,
        **{name: asdict(of) | {"fast_gain": of.fast_gain} for name, of in each.items()},
        "eddies": asdict(branches),
    }
