# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design export`: parameter file of a valve that a designed solenoid moves."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.cli.common import OK, add_verb, check_writable, progress_of, say
from valve_twin.cli.design.given import add_design, read_double_stroke, refusals
from valve_twin.cli.output import print_json

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs

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


def _export(arguments: argparse.Namespace) -> int:
    design = read_double_stroke(arguments)
    check_writable(arguments.out)
    from valve_twin.core.valves.designed import find_designable
    from valve_twin.design.chain import compute_design
    from valve_twin.design.map import read_map
    from valve_twin.io.config.exported import exported_yaml
    from valve_twin.io.config.valve import load_config

    with refusals():
        valve = find_designable(arguments.valve)
        curves = read_map(Path(arguments.map)) if arguments.map else None
        with progress_of("computing fields", None) as advance:
            designed, dynamics = compute_design(design, curves, advance=advance)
        numbers = valve.of_design(designed)
    like = Path(arguments.like) if arguments.like else _CONFIG / f"{valve.name}.yaml"
    source = designed.curves.provenance
    title = f"{source['name']}, map {source['sha256']}: written by valve-twin design export"
    text = exported_yaml(like, valve.name, numbers.shared, numbers.own, title)
    Path(arguments.out).write_text(text, encoding="utf-8")
    load_config(Path(arguments.out))
    say(f"{arguments.out}: written")
    fits = {name: found.fit for name, found in zip(("G_A", "G_F"), dynamics, strict=True)}
    print_json({"map": source["sha256"], "resistance": designed.resistance, "fit": fits})
    return OK
