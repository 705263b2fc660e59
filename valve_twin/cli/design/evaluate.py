# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design evaluate`: from a geometry to the steps of its valve."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING

from valve_twin.cli.common import OK, add_verb, check_writable, progress_of, say, write_file
from valve_twin.cli.design.given import add_design, add_form, form_of, read_double_stroke, refusals
from valve_twin.cli.output import console, number, print_json, table
from valve_twin.io.errors import ConfigError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Mapping

    from valve_twin.cli.common import Verbs
    from valve_twin.core.valves.designed import Loop
    from valve_twin.design.chain import Evaluation, Fidelity
    from valve_twin.design.geometry import DoubleStroke

_FIGURES = (
    ("rise_s", "rise, ms", 1e3, ".2f"),
    ("overshoot", "overshoot, %", 1e2, ".2f"),
    ("settling_s", "settling, ms", 1e3, ".2f"),
    ("error", "error, %", 1e2, ".2f"),
    ("loss", "loss, W", 1.0, ".3f"),
)

_REPLAYED = 0.5  # which step, where none is named


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
        "--shares", type=float, nargs="+", metavar="SHARE",
        help="steps that --replay follows: 0.1, 0.25, 0.5 (default), 1",
    )  # fmt: skip
    add_form(parser)
    parser.add_argument("--svg", metavar="FILE", help="picture to write")
    parser.add_argument("--json", action="store_true", help="one JSON object")


def _evaluate(arguments: argparse.Namespace) -> int:
    design = read_double_stroke(arguments)
    check_writable(arguments.svg)
    from valve_twin.core.valves.designed import find_designable
    from valve_twin.design.chain import STEPS, evaluate, find_fidelity, short_of_current

    missing = [share for share in arguments.shares or () if share not in STEPS]
    if missing:
        known = ", ".join(f"{share:g}" for share in STEPS)
        msg = f"--shares {missing[0]:g}: must be one of {known}"
        raise ConfigError(msg)
    if arguments.shares and not arguments.replay:
        msg = "--shares: says which steps --replay follows; add --replay"
        raise ConfigError(msg)
    with refusals():
        valve = find_designable(arguments.valve)
        of, form = find_fidelity(arguments.fidelity), form_of(arguments)
        with progress_of("computing fields", None) as advance:
            found = evaluate(
                design,
                valve,
                robust=arguments.robust,
                fidelity=of,
                advance=advance,
                form=form,
            )
        shares = (arguments.shares or [_REPLAYED]) if arguments.replay else []
        again = {share: _replayed(design, found, of, share) for share in shares}
    if arguments.svg:
        from valve_twin.report.loop import draw_loops

        write_file(arguments.svg, draw_loops(found.loops))
    short = short_of_current(found.designed)
    if short:
        say(short)
    worst = {share: _worst(found, share) for share in found.loops} if arguments.robust else {}
    if arguments.json:
        replayed = [{"step": share, **figures, "lacks": _lacks(figures["fit"], form)}
                    for share, figures in again.items()]  # fmt: skip
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
    for share, figures in again.items():
        say(
            f"step of {100 * share:g} % in the moving field: the model's force fits "
            f"{figures['fit']:.1f} %, off by {figures['error']:.2g} N rms; static curves alone "
            f"{figures['without']:.1f} %; G_F fitted to this step {figures['refitted']:.1f} %"
        )
        lacks = _lacks(figures["fit"], form)
        if lacks:
            say(f"step of {100 * share:g} %: {lacks}")
    return OK


def _replayed(
    design: DoubleStroke, found: Evaluation, of: Fidelity, share: float
) -> dict[str, float]:
    from valve_twin.design.dynamics import replay

    curves, loop = found.designed.curves, found.loops[share]
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
