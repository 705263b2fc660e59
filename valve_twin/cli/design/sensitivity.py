# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design sensitivity`: which dimension matters."""

from __future__ import annotations

import math
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from valve_twin.cli.common import (
    FAILED,
    OK,
    add_runner,
    add_verb,
    check_writable,
    ends_as_interrupted,
    positive,
    progress_of,
    runner_of,
    say,
    seed_number,
    share_number,
    write_file,
)
from valve_twin.cli.design.given import (
    add_design,
    archive_at,
    read_double_stroke,
    refusals,
    require,
)
from valve_twin.cli.output import number, plain, print_json, print_rows, table

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterator, Sequence

    from valve_twin.cli.common import Verbs
    from valve_twin.design.geometry import DoubleStroke
    from valve_twin.design.search.archive import Archive
    from valve_twin.design.search.sensitivity import Effect, Indices, Study
    from valve_twin.design.search.tasks import Outcome

_MOST = 6  # numbers of the indices where none are named: those that change the loop the most

LOOP_COLUMNS = (
    ("rise_s", "rise"),
    ("settling_s", "settling"),
    ("overshoot", "overshoot"),
    ("loss", "loss"),
)
"""Figures of the loop with their label; overshoot in points of the step, others as shares."""

_DYNAMIC = tuple(
    (f"{of}_{kind}_{k}_hz", f"{label} {kind} {k}")
    for of, label in (("current", "G_A"), ("force", "G_F"))
    for kind in ("pole", "zero")
    for k in (1, 2)
)


def add(steps: Verbs) -> None:
    """Add the step."""
    text = "Change every dimension alone, and on demand all together (Sobol' indices)."
    parser = add_verb(steps, "sensitivity", text, _sensitivity)
    add_design(parser)
    add_study(parser)
    parser.add_argument("--svg", metavar="FILE", help="picture to write")
    parser.add_argument("--json", action="store_true", help="one JSON object")


def add_study(parser: argparse.ArgumentParser) -> None:
    """Add how sensitivities are computed."""
    parser.add_argument("--valve", default="", metavar="NAME", help="model, default the only one")
    parser.add_argument(
        "--of",
        action="append",
        default=[],
        metavar="NAME",
        help="a number, default all dimensions",
    )
    parser.add_argument(
        "--share", type=share_number, metavar="X", help="change up and down [1], default 0.05"
    )
    parser.add_argument(
        "--sobol", type=positive, metavar="N",
        help="also Sobol' indices, on a surrogate of N designs that are computed; of the numbers "
        f"of --of, else of the {_MOST} that change the loop the most",
    )  # fmt: skip
    parser.add_argument("--seed", type=seed_number, default=0, metavar="N", help="of --sobol")
    parser.add_argument(
        "--fidelity", default="evened", metavar="NAME",
        help="fields: evened (default: coarse, all on the stretched mesh of the design itself, "
        "the loop's figures as means of five draws of the sensors' noise), search, usual or twice",
    )  # fmt: skip
    parser.add_argument(
        "--archive", metavar="FILE", help="evaluated designs, kept and used; as of optimise"
    )
    add_runner(parser, "with the same version of valve_twin")


def _sensitivity(arguments: argparse.Namespace) -> int:
    design = read_double_stroke(arguments)
    check_writable(arguments.archive, arguments.svg)
    ends_as_interrupted()
    try:
        with opened(arguments, design) as archive:
            middle, effects, indices = run_study(arguments, design, archive)
    except KeyboardInterrupt:
        kept = "; the same command goes on" if arguments.archive else ""
        say(f"valve-twin: interrupted{kept}")
        return FAILED
    if arguments.svg:
        write_file(arguments.svg, picture_of(middle, effects))
    if arguments.json:
        print_json(_as_json(middle, effects, indices))
        return OK
    _show(middle, effects, indices)
    return OK


@contextmanager
def opened(arguments: argparse.Namespace, design: DoubleStroke) -> Iterator[Archive]:
    """Open the archive of the arguments, else one that is gone afterwards.

    Raises
    ------
    ConfigError
        If it is none of this design, or another run uses it.
    """
    with TemporaryDirectory() as folder:
        path = Path(arguments.archive or Path(folder) / "archive.jsonl")
        with archive_at(path, design, arguments.valve) as archive:
            yield archive


def run_study(
    arguments: argparse.Namespace, design: DoubleStroke, archive: Archive
) -> tuple[Outcome, tuple[Effect, ...], tuple[Indices, ...]]:
    """Compute the sensitivities that the arguments of `add_study` ask for.

    Parameters
    ----------
    arguments : argparse.Namespace
        Of `add_study`.
    design : DoubleStroke
        The design.
    archive : Archive
        Of changes of it.

    Raises
    ------
    ConfigError
        If a name is unknown or the design cannot be evaluated.
    """
    from valve_twin.design.chain import find_fidelity
    from valve_twin.design.search.sensitivity import (
        SHARE,
        Study,
        fewest_designs,
        names_of,
        one_at_a_time,
        sobol_indices,
    )
    from valve_twin.design.search.tasks import evaluate_task, lost_design

    share, run = (
        arguments.share or SHARE,
        runner_of(arguments, evaluate_task, lost_design, keep=True),
    )
    if arguments.sobol:
        require("SALib")
    with refusals():
        names = names_of(design, arguments.of)
        find_fidelity(arguments.fidelity)
        if arguments.sobol:  # before minutes of fields
            fewest_designs(len(arguments.of) or min(_MOST, len(names)), arguments.sobol)

        def study(advance: Callable[[], None]) -> Study:
            return Study(design, archive, run, arguments.valve, arguments.fidelity, advance)

        with progress_of("one at a time", 2 * len(names) + 1) as advance:
            middle, effects = one_at_a_time(study(advance), names, share)
        if not arguments.sobol:
            return middle, effects, ()
        names = tuple(arguments.of) or _strongest(middle, effects)
        with progress_of("all together", arguments.sobol) as advance:
            indices = sobol_indices(
                study(advance), names, arguments.sobol, share=share, seed=arguments.seed
            )
    return middle, effects, indices


def _strongest(middle: Outcome, effects: Sequence[Effect]) -> tuple[str, ...]:
    """Return the numbers that change rise, settling and loss the most."""

    def size(of: Effect) -> float:
        changes = [abs(change(middle, of, key, k)) for key in ("rise_s", "settling_s", "loss")
                   for k in (0, 1)]  # fmt: skip
        return sum(c for c in changes if math.isfinite(c))

    return tuple(of.name for of in sorted(effects, key=size, reverse=True)[:_MOST])


def change(middle: Outcome, of: Effect, key: str, side: int) -> float:
    """Return how a figure changes: overshoot by so much, any other over its value [1].

    Parameters
    ----------
    middle : Outcome
        The design itself.
    of : Effect
        Of a number.
    key : str
        Name of the figure.
    side : int
        0 = the lower number, 1 = the higher.
    """
    value, own = of.figures[key][side], middle.figures[key]
    if key == "overshoot":
        return value - own
    return value / own - 1.0 if own and math.isfinite(own) else math.nan


def picture_of(middle: Outcome, effects: Sequence[Effect]) -> str:
    """Return the picture of the changes of the loop as an SVG document.

    Parameters
    ----------
    middle : Outcome
        The design itself.
    effects : sequence of Effect
        One a number.
    """
    from valve_twin.report.design.effects import draw_effects

    rows = {
        of.name: [
            (math.nan, 100 * of.force),
            (math.nan, 100 * of.flux),
            *(
                (100 * change(middle, of, key, 0), 100 * change(middle, of, key, 1))
                for key, _ in LOOP_COLUMNS
            ),
        ]
        for of in effects
    }
    labels = ["largest of force", "largest of psi", *(label for _, label in LOOP_COLUMNS)]
    return draw_effects(labels, rows, "%", ("lower", "higher"))


def effect_rows(middle: Outcome, effects: Sequence[Effect]) -> tuple[list[str], list[list[str]]]:
    """Return headings and cells of the table of effects.

    Parameters
    ----------
    middle : Outcome
        The design itself.
    effects : sequence of Effect
        One a number.
    """
    head = ["number", "force, %", "psi, %", *(f"{label}, %" for _, label in LOOP_COLUMNS)]
    head += [f"{label}, %" for _, label in _DYNAMIC]
    rows = []
    for of in effects:
        if of.error and all(math.isnan(v) for v in of.figures["rise_s"]):
            rows.append([of.name, *["-"] * (len(head) - 1)])
            continue
        cells = [number(100 * of.force, ".1f"), number(100 * of.flux, ".1f")]
        for key, _ in (*LOOP_COLUMNS, *_DYNAMIC):
            both = (number(100 * change(middle, of, key, k), "+.1f") for k in (0, 1))
            cells.append("/".join(both))
        rows.append([of.name, *cells])
    return head, rows


def index_rows(indices: Sequence[Indices]) -> tuple[list[str], list[list[str]]]:
    """Return headings and cells of the table of Sobol' indices.

    Parameters
    ----------
    indices : sequence of Indices
        One a figure.
    """
    head = ["figure", "surrogate", "error", "told, %", "number", "first", "total"]
    rows = []
    for of in indices:
        s = of.surrogate
        told = [s.kind, number(s.error, ".3g"), number(100 * s.told, ".0f")] if s else ["-"] * 3
        if of.refused:
            rows.append([of.figure, *told, "refused", "-", "-"])
        for name in of.first:
            cells = [
                f"{m:.2f} ({low:.2f} to {high:.2f})"
                for m, low, high in (of.first[name], of.total[name])
            ]
            rows.append([of.figure, *told, name, *cells])
    return head, rows


def _show(middle: Outcome, effects: Sequence[Effect], indices: Sequence[Indices]) -> None:
    head, rows = effect_rows(middle, effects)
    for title, part in (
        ("Each number alone, lower/higher: largest change of the curves, changes of the loop", 7),
        ("Changes of the dynamics", 0),
    ):
        columns = [0, *range(1, part)] if part else [0, *range(7, len(head))]
        shown = table(title, [head[0]], [head[k] for k in columns[1:]])
        print_rows(shown, ([row[k] for k in columns] for row in rows))
    for of in effects:
        if of.error:
            say(f"{of.name}: {of.error}")
    if indices:
        head, rows = index_rows(indices)
        print_rows(table("Sobol' indices with 95 % intervals", head[:2], head[2:]), rows)
        for index in indices:
            if index.refused:
                say(f"{index.figure}: no indices: {index.refused}")


def _as_json(
    middle: Outcome, effects: Sequence[Effect], indices: Sequence[Indices]
) -> dict[str, object]:
    found = {
        "design": dict(middle.figures),
        "effects": [asdict(of) for of in effects],
        "sobol": [
            {
                "figure": of.figure,
                "surrogate": of.surrogate.kind if of.surrogate else None,
                "error": of.surrogate.error if of.surrogate else None,
                "told": of.surrogate.told if of.surrogate else None,
                "first": dict(of.first),
                "total": dict(of.total),
                "refused": of.refused,
            }
            for of in indices
        ],
    }
    return {key: plain(value) for key, value in found.items()}
