# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design optimise`: search for better designs, resumable."""

from __future__ import annotations

from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.cli.common import (
    FAILED,
    OK,
    add_runner,
    add_verb,
    check_writable,
    ends_as_interrupted,
    progress_of,
    runner_of,
    say,
)
from valve_twin.cli.design.given import (
    add_design,
    archive_at,
    read_double_stroke,
    refusals,
    require,
)
from valve_twin.cli.output import console, number, print_json, table
from valve_twin.io.errors import ConfigError
from valve_twin.io.whole import write_whole

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs
    from valve_twin.design.search.front import Limits
    from valve_twin.design.search.optimise import Found, Progress

COLUMNS = (
    ("rise_s", "rise, ms", 1e3, ".2f"),
    ("settling_s", "settling, ms", 1e3, ".2f"),
    ("graded_s", "in 1 to 4 %, ms", 1e3, ".2f"),
    ("overshoot", "overshoot, %", 1e2, ".2f"),
    ("error", "error, %", 1e2, ".2f"),
    ("loss", "loss, W", 1.0, ".3f"),
    ("heating", "heating, K", 1.0, ".1f"),
    ("margin", "margin, N", 1.0, ".0f"),
)
"""Figures with their label, factor and format."""

_LIMITS = (
    ("overshoot", "most overshoot of any step [1], default 0.05"),
    ("loss", "most loss over that of the reference [1], default 1.15"),
    ("heating", "most heating of the yoke [K], default 60"),
    ("margin", "least force left [N], default 20"),
)


def add(steps: Verbs) -> None:
    """Add the step."""
    text = "Search for better designs; run it again to go on after an interruption."
    parser = add_verb(steps, "optimise", text, _optimise)
    add_design(parser)
    parser.add_argument(
        "--archive", required=True, metavar="FILE", help="all evaluated designs, kept and used"
    )
    parser.add_argument("--valve", default="", metavar="NAME", help="model, default the only one")
    parser.add_argument(
        "--vary", action="append", default=[], metavar="NAME=LOW:HIGH",
        help="a number to change and its bounds; default ten of geometry, turns, springs, control",
    )  # fmt: skip
    for name, about in (
        ("population", "designs of a generation, default 16"),
        ("generations", "default 10"),
        ("seed", "of all random numbers, default 0"),
    ):
        parser.add_argument(f"--{name}", type=int, metavar="N", help=about)
    parser.add_argument(
        "--seconds", type=float, metavar="S",
        help="time after which no generation is begun any more, default any; its front is "
        "computed after it",
    )  # fmt: skip
    for name, about in (
        ("fidelity", "fields of the search: search (coarse, default), usual or twice"),
        (
            "final",
            "fields of the front: twice (default; leaves out designs whose figures differ on "
            "usual), usual or search",
        ),
    ):
        parser.add_argument(f"--{name}", metavar="NAME", help=about)
    add_limits(parser)
    add_runner(parser, "with the same version of valve_twin")
    parser.add_argument("--yaml", metavar="FILE", help="numbers of the chosen design to write")
    parser.add_argument("--json", action="store_true", help="one JSON object")


def _optimise(arguments: argparse.Namespace) -> int:
    design = read_double_stroke(arguments)
    require("pymoo")
    check_writable(arguments.archive, arguments.yaml)
    from valve_twin.design.geometry import write_design
    from valve_twin.design.search.optimise import VARIED, Settings, make_problem, optimise
    from valve_twin.design.search.tasks import evaluate_task, lost_design
    from valve_twin.design.search.variables import changed

    names = [f.name for f in fields(Settings) if f.name != "limits"]
    given = {n: getattr(arguments, n) for n in names if getattr(arguments, n) is not None}
    with refusals():
        kept = limits_of(arguments)
        settings = Settings(**given, limits=kept)
        problem = make_problem(design, bounds_of(arguments.vary) or VARIED, arguments.valve)
    run = runner_of(arguments, evaluate_task, lost_design, keep=True)
    ends_as_interrupted()
    total = settings.population * settings.generations
    with archive_at(Path(arguments.archive), design, arguments.valve) as archive:
        try:
            with refusals(), progress_of("evaluating designs", total) as advance:
                found = optimise(problem, settings, archive, run, _tell, advance, advance.more)
        except KeyboardInterrupt:
            known = sum(1 for _ in archive)
            say(f"valve-twin: interrupted: {known} designs are kept; the same command goes on")
            return FAILED
    say(found.ended)
    if arguments.yaml:
        write_design(changed(design, found.chosen.values), Path(arguments.yaml), write_whole)
        say(f"{arguments.yaml}: written")
    if arguments.json:
        print_json(_as_json(found))
        return OK
    _show(found, kept)
    return OK


def add_limits(parser: argparse.ArgumentParser) -> None:
    """Add what a design has to keep."""
    for name, about in _LIMITS:
        word = "least" if name == "margin" else "most"
        parser.add_argument(
            f"--{word}-{name}", dest=f"limit_{name}", type=float, metavar="X", help=about
        )


def limits_of(arguments: argparse.Namespace) -> Limits:
    """Return the limits of `add_limits`.

    Raises
    ------
    ValueError
        If one is out of range.
    """
    from valve_twin.design.search.front import Limits

    given = {name: getattr(arguments, f"limit_{name}") for name, _ in _LIMITS}
    return Limits(**{name: value for name, value in given.items() if value is not None})


def bounds_of(texts: list[str]) -> dict[str, tuple[float, float]]:
    """Return bounds by name of NAME=LOW:HIGH.

    Raises
    ------
    ConfigError
        If a text is none.
    """
    found = {}
    for text in texts:
        name, _, both = text.partition("=")
        low, _, high = both.partition(":")
        try:
            found[name] = float(low), float(high)
        except ValueError as err:
            msg = f"--vary {text}: write NAME=LOW:HIGH, such as gap_ratio=0.16:0.24"
            raise ConfigError(msg) from err
    return found


def _tell(at: Progress) -> None:
    say(
        f"generation {at.generation} of {at.generations}: {at.designs} designs, {at.failed} "
        f"failed, {at.kept} within all limits, {at.front} on the front, hypervolume "
        f"{at.hypervolume:.5f}"
    )


def _show(found: Found, limits: Limits) -> None:
    title = "Means of 10, 25, 50, 100 % (overshoot, error: the largest); the chosen one has a star"
    shown = table(title, ["design"], [label for _, label, *_ in COLUMNS])
    rows = [("reference", found.reference)]
    for k, of in enumerate(found.front, start=1):
        rows.append((f"{k}{' *' if of is found.chosen else ''}", of))
    for name, of in rows:
        cells = (number(factor * of.figures[key], form) for key, _, factor, form in COLUMNS)
        shown.add_row(name, *cells)
    console().print(shown)
    for name, value in found.chosen.values.items():
        say(f"{name}: {value:g}")
    if found.apart:
        say(f"{len(found.apart)} designs left out: their figures differ on fields half as fine")
    if not limits.keeps(found.reference, found.reference.figures):
        said = limits.said(found.reference, found.reference.figures)
        say(f"the reference itself does not keep the limits: {said}")


def _as_json(found: Found) -> dict[str, object]:
    return {
        "reference": dict(found.reference.figures),
        "front": [{"values": dict(of.values), "figures": dict(of.figures)} for of in found.front],
        "apart": [{"values": dict(of.values), "figures": dict(of.figures)} for of in found.apart],
        "chosen": dict(found.chosen.values),
        "ended": found.ended,
        "history": [asdict(at) for at in found.history],
    }
