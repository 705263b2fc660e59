# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design evaluate`: from a geometry to the steps of its valve."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING

from valve_twin.cli.common import OK, add_verb, check_writable, progress_of, say, write_file
from valve_twin.cli.design.given import add_design, add_form, read_double_stroke, refusals
from valve_twin.cli.output import console, number, print_json, table
from valve_twin.io.errors import ConfigError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Mapping

    from valve_twin.cli.common import Verbs
    from valve_twin.core.valves.designed import Designable, Loop
    from valve_twin.design.chain import Evaluation, Fidelity
    from valve_twin.design.geometry import DoubleStroke

_FIGURES = (
    ("rise_s", "rise, ms", 1e3, ".2f"),
    ("overshoot", "overshoot, %", 1e2, ".2f"),
    ("settling_s", "settling, ms", 1e3, ".2f"),
    ("error", "error, %", 1e2, ".2f"),
    ("loss", "loss, W", 1.0, ".3f"),
)

_REPLAYED = "0.5"  # which step, where none is named


def add(steps: Verbs) -> None:
    """Add the step."""
    parser = add_verb(steps, "evaluate", "Follow steps of the valve of a geometry.", _evaluate)
    add_design(parser)
    parser.add_argument("--valve", default="", metavar="NAME", help="model, default the only one")
    parser.add_argument(
        "--robust", action="store_true",
        help="also the worst of friction, supply and copper 10 %% lower and higher",
    )  # fmt: skip
    parser.add_argument(
        "--fidelity", default="usual", metavar="NAME",
        help="fields: usual (default), search (coarse), twice (twice the elements a line) or "
        "matched (map and eddy currents on one mesh)",
    )  # fmt: skip
    parser.add_argument(
        "--replay", action="store_true",
        help="also the step of 50 %% once more in the moving field with eddy currents",
    )  # fmt: skip
    parser.add_argument(
        "--shares", nargs="+", metavar="STEP",
        help="steps that --replay follows, over the way to an open port: 0.5 (default) is from "
        "the middle, 1:0 from an open port back to the middle, 0.5:-1 across it; "
        "--shares=-0.5:1 one that begins on the other side",
    )  # fmt: skip
    add_form(parser)
    parser.add_argument("--svg", metavar="FILE", help="picture to write")
    parser.add_argument("--json", action="store_true", help="one JSON object")


def _evaluate(arguments: argparse.Namespace) -> int:
    design = read_double_stroke(arguments)
    check_writable(arguments.svg)
    from valve_twin.core.valves.designed import find_designable
    from valve_twin.design.chain import evaluate, find_fidelity, short_of_current

    steps = [_ends_of(text) for text in arguments.shares or [_REPLAYED]]
    if arguments.shares and not arguments.replay:
        msg = "--shares: says which steps --replay follows; add --replay"
        raise ConfigError(msg)
    with refusals():
        valve = find_designable(arguments.valve)
        of, form = find_fidelity(arguments.fidelity), arguments.dynamics
        with progress_of("computing fields", None) as advance:
            found = evaluate(
                design,
                valve,
                robust=arguments.robust,
                fidelity=of,
                advance=advance,
                form=form,
            )
        again = [(ends, _replayed(design, valve, found, of, ends))
                 for ends in (steps if arguments.replay else ())]  # fmt: skip
    if arguments.svg:
        from valve_twin.report.loop import draw_loops

        write_file(arguments.svg, draw_loops(found.loops))
    short = short_of_current(found.designed)
    if short:
        say(short)
    worst = {share: _worst(found, share) for share in found.loops} if arguments.robust else {}
    if arguments.json:
        replayed = [{"from": ends[0], "step": ends[1], "fitted_to": _fitted_to(ends, form),
                     **figures, "lacks": _lacks(figures["fit"], form)}
                    for ends, figures in again]  # fmt: skip
        print_json(_as_json(found, worst) | {"replay": replayed})
        return OK
    _show({share: _figures(of) for share, of in found.loops.items()}, "Steps from the middle")
    if worst:
        _show(worst, "The worst of 8 with friction, supply, copper 10 % lower or higher")
    of_current, of_force = found.dynamics
    say(
        f"force margin {found.margin:.3g} N; G_A fits {of_current.fit:.1f} %, G_F "
        f"{of_force.fit:.1f} %"
    )
    for ends, figures in again:
        told = f" ({form} was fitted to it)" if _fitted_to(ends, form) else ""
        say(
            f"{_named(ends)} in the moving field{told}: the model's force fits "
            f"{figures['fit']:.1f} %, off by {figures['error']:.2g} N rms; static curves alone "
            f"{figures['without']:.1f} %; G_F fitted to this step {figures['refitted']:.1f} %"
        )
        lacks = _lacks(figures["fit"], form)
        if lacks:
            say(f"{_named(ends)}: {lacks}")
    return OK


def _ends_of(text: str) -> tuple[float, float]:
    """Return start and end of a step that is written STEP or FROM:TO [1]."""
    first, colon, second = text.partition(":")
    try:
        start, end = (float(first), float(second)) if colon else (0.0, float(first))
    except ValueError:
        start = end = math.nan
    if not (abs(start) <= 1.0 and abs(end) <= 1.0 and start != end):
        msg = f"--shares {text}: write a step as 0.5 or FROM:TO, two numbers from -1 to 1"
        raise ConfigError(msg)
    return start, end


def _named(ends: tuple[float, float]) -> str:
    start, end = (100 * of for of in ends)
    return f"step from {start:g} to {end:g} %" if start else f"step of {end:g} %"


def _fitted_to(ends: tuple[float, float], form: str) -> bool:
    from valve_twin.design.dynamics.growing import FITTED

    return form == "growing" and ends in FITTED


def _replayed(
    design: DoubleStroke,
    valve: Designable,
    found: Evaluation,
    of: Fidelity,
    ends: tuple[float, float],
) -> dict[str, float]:
    from valve_twin.design.dynamics import replay

    curves = found.designed.curves
    loop = valve.loop(found.numbers, ends[1], {}, ends[0])
    again = replay(design.section(), curves, loop, of.fine, of.skin)
    return {n: float(getattr(again, n)) for n in ("fit", "without", "refitted", "error")}


def _lacks(fit: float, form: str) -> str:
    """Return what a form lacks and what to take in its place; "" where the force fits."""
    from valve_twin.design.dynamics.replay import LACKS, WANTED

    return "" if fit >= WANTED else f"below {WANTED:g} %: {LACKS[form]}"


def _figures(of: Loop) -> dict[str, float]:
    return {name: getattr(of, name) for name, *_ in _FIGURES}


def _worst(found: Evaluation, share: float) -> dict[str, float]:
    """Return the largest of each figure; NaN, which never gets there, is the largest of all."""
    runs = [_figures(case[share]) for case in found.robust]
    return {name: max((run[name] for run in runs), key=_rank) for name, *_ in _FIGURES}


def _rank(value: float) -> tuple[bool, float]:
    return (True, 0.0) if math.isnan(value) else (False, value)


def _show(figures: Mapping[float, Mapping[str, float]], title: str) -> None:
    shown = table(title, ["step"], [label for _, label, *_ in _FIGURES])
    for share, values in figures.items():
        cells = [number(factor * values[name], form) for name, _, factor, form in _FIGURES]
        shown.add_row(f"{100 * share:g} %", *cells)
    console().print(shown)


def _as_json(found: Evaluation, worst: Mapping[float, Mapping[str, float]]) -> dict[str, object]:
    steps = [{"step": share, **_finite(_figures(of))} for share, of in found.loops.items()]
    both = zip(("G_A", "G_F"), found.dynamics, strict=True)
    return {
        "steps": steps,
        "worst": [{"step": share, **_finite(v)} for share, v in worst.items()],
        "force_margin": found.margin,
        "dynamics": {name: asdict(of) for name, of in both},
    }


def _finite(values: Mapping[str, float]) -> dict[str, float | None]:
    """Return values as JSON holds them: null where a step does not settle."""
    return {name: value if math.isfinite(value) else None for name, value in values.items()}
