# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design export`: parameter file of a valve that a designed solenoid moves."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.cli.common import OK, add_verb, check_writable, progress_of, say
from valve_twin.cli.design.given import (
    add_design,
    add_form,
    read_double_stroke,
    read_map_of,
    refusals,
)
from valve_twin.cli.output import print_json
from valve_twin.io.whole import write_whole

if TYPE_CHECKING:
    import argparse
    from collections.abc import Mapping

    from valve_twin.cli.common import Verbs
    from valve_twin.core.physics.coenergy import CoenergyMap
    from valve_twin.core.valves.designed import Designable, Numbers
    from valve_twin.design.geometry import DoubleStroke

_CONFIG = Path(__file__).resolve().parents[3] / "config"


def add(steps: Verbs) -> None:
    """Add the step."""
    text = "Write the parameter file of valve and twin with a designed solenoid."
    parser = add_verb(steps, "export", text, _export)
    add_design(parser)
    parser.add_argument("--out", required=True, metavar="FILE", help="parameter file to write")
    parser.add_argument("--map", metavar="FILE", help="map of the same design; default: computed")
    parser.add_argument("--valve", default="", metavar="NAME", help="model, default the only one")
    parser.add_argument(
        "--like", metavar="FILE", help="parameter file whose other keys are kept, default that "
        "of the model in config/",
    )  # fmt: skip
    add_form(parser, "growing")
    parser.add_argument(
        "--faults", action="store_true", help="also how worn dimensions change its curves: the "
        "twin then names the one that has drifted",
    )  # fmt: skip
    parser.add_argument(
        "--doubts", action="store_true", help="also what mesh, steel and gaps leave in doubt of "
        "its curves: the twin's intervals then hold it",
    )  # fmt: skip


def _export(arguments: argparse.Namespace) -> int:
    design = read_double_stroke(arguments)
    check_writable(arguments.out)
    from valve_twin.core.valves.designed import find_designable
    from valve_twin.design.chain import compute_design, short_of_current
    from valve_twin.io.config.exported import exported_yaml
    from valve_twin.io.config.valve import load_config

    with refusals():
        valve = find_designable(arguments.valve)
        like = Path(arguments.like) if arguments.like else _CONFIG / f"{valve.name}.yaml"
        exported_yaml(like, valve.name, {}, {}, "")  # refused before fields are computed
        curves = read_map_of(arguments.map, design) if arguments.map else None
        with progress_of("computing fields", None) as advance:
            designed, dynamics = compute_design(
                design, curves, advance=advance, form=arguments.dynamics, valve=valve
            )
        numbers = valve.of_design(designed)
        twin, apart = _faults(design, valve, numbers) if arguments.faults else ({}, {})
        if arguments.doubts:
            twin = {**twin, **_doubts(design, valve, designed.curves)}
    source = designed.curves.provenance
    title = f"{source['name']}, map {source['sha256']}: written by valve-twin design export"
    text = exported_yaml(like, valve.name, numbers.shared, numbers.own, title, twin)
    write_whole(arguments.out, text)
    load_config(Path(arguments.out))
    say(f"{arguments.out}: written")
    short = short_of_current(designed)
    if short:
        say(short)
    say(f"next: make demo VALVE={valve.name} CONFIG={Path(arguments.out).resolve()}")
    fits = {name: found.fit for name, found in zip(("G_A", "G_F"), dynamics, strict=True)}
    told = {"map": source["sha256"], "resistance": designed.resistance, "fit": fits}
    print_json(told | {"eddies": designed.eddies} | apart)
    return OK


def _doubts(design: DoubleStroke, valve: Designable, curves: CoenergyMap) -> Mapping[str, object]:
    """Return the options of a twin whose intervals hold the doubts about its map."""
    from valve_twin.design.doubt import compute_doubts

    with progress_of("computing doubts", None) as advance:
        return valve.of_doubts(compute_doubts(design, curves, advance=advance))


def _faults(
    design: DoubleStroke, valve: Designable, numbers: Numbers
) -> tuple[Mapping[str, object], dict[str, object]]:
    """Return the options of a twin that names drifted dimensions, and what it cannot tell."""
    from valve_twin.design.wear import compute_wear

    with progress_of("computing worn dimensions", None) as advance:
        wear = compute_wear(design, advance=advance)
    apart = valve.told_apart(numbers, wear)
    nearest = {}
    for k, name in enumerate(apart.causes):
        others = [j for j in range(len(apart.causes)) if j != k]
        at = min(others, key=lambda j: float(apart.leaves[k, j]))
        nearest[name] = {
            "nearest": apart.causes[at],
            "leaves": round(float(apart.leaves[k, at]), 4),
        }
    return valve.of_wear(wear), {"causes": nearest, "not_told_apart": apart.together}
