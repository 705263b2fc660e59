# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design report`: the page of a search, with drawing and numbers of its design."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.cli.common import OK, add_verb, progress_of, say
from valve_twin.cli.design.given import add_design, read_double_stroke, refusals
from valve_twin.cli.design.optimise import COLUMNS, add_limits, limits_of
from valve_twin.cli.design.sensitivity import (
    add_study,
    effect_rows,
    index_rows,
    opened,
    picture_of,
    run_study,
)
from valve_twin.cli.output import number
from valve_twin.io.errors import ConfigError
from valve_twin.io.whole import write_all

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from valve_twin.cli.common import Verbs
    from valve_twin.design.chain import Evaluation
    from valve_twin.design.geometry import DoubleStroke
    from valve_twin.design.search.archive import Archive
    from valve_twin.design.search.front import Limits
    from valve_twin.design.search.tasks import Outcome
    from valve_twin.report.design.page import Side
    from valve_twin.report.tables import Table

_CURRENT = 2.0  # of coil A in the pictures of the field [A]
_AXES = (
    ("rise_s", 1e3, "rise [ms]"),
    ("graded_s", 1e3, "settling in 1 to 4 % [ms]"),
    ("loss", 1.0, "loss [W]"),
)


def add(steps: Verbs) -> None:
    """Add the step."""
    text = "Write the page of a search: front, chosen design, sensitivities, drawing, numbers."
    parser = add_verb(steps, "report", text, _report)
    add_design(parser)
    add_study(parser)
    add_limits(parser)
    parser.add_argument("--final", default="twice", metavar="NAME", help="as of optimise")
    parser.add_argument(
        "--sensitivity", action="store_true", help="also sensitivities of the reference"
    )
    parser.add_argument("--out", required=True, metavar="FOLDER", help="folder, made or filled")


def _report(arguments: argparse.Namespace) -> int:
    design = read_double_stroke(arguments)
    if not arguments.archive or not Path(arguments.archive).is_file():
        given = f" {arguments.archive}" if arguments.archive else ""
        msg = f"--archive{given}: name the file of valve-twin design optimise"
        raise ConfigError(msg)
    folder = Path(arguments.out)
    folder.mkdir(parents=True, exist_ok=True)
    from valve_twin.design.geometry import write_design, write_dxf
    from valve_twin.design.search.variables import changed
    from valve_twin.report.design.page import DesignPage, render_design
    from valve_twin.report.tables import Table

    with opened(arguments, design) as archive, refusals():
        limits = limits_of(arguments)
        reference, front, chosen = _final(archive, design, limits, arguments.final)
        effects: list[tuple[str, str, Table, str]] = []
        if arguments.sensitivity or arguments.sobol:
            effects = _effects(arguments, design, archive)
        better = changed(design, chosen.values)
        sides = tuple(
            _side(name, of, arguments)
            for name, of in (("Reference", design), ("Chosen design", better))
        )
        tried = [of.figures for of in archive if of.figures]
    files: dict[Path, bytes] = {}
    write_design(better, folder / "chosen.yaml", files.__setitem__)
    write_dxf(better.section(), folder / "chosen.dxf", files.__setitem__)
    page = DesignPage(
        title="A double-stroke solenoid and its valve",
        summary=_summary(reference, chosen, front),
        front=_picture(tried, front, reference, chosen),
        figures=Table(
            ["design", *(label for _, label, *_ in COLUMNS)],
            [
                _figure_row("reference", reference),
                *(
                    _figure_row(f"{k}{' (chosen)' if of is chosen else ''}", of)
                    for k, of in enumerate(front, start=1)
                ),
            ],
        ),
        numbers=_numbers(design, better, chosen),
        sides=sides,
        effects=tuple(effects),
        files=(
            ("chosen.yaml", "all numbers of the chosen design; valve-twin design export makes "
             "the parameter file of valve and twin of it"),
            ("chosen.dxf", "its half section, millimetres, a layer a region"),
        ),
        notes=_notes(archive, arguments.final),
    )  # fmt: skip
    files[folder / "report.html"] = render_design(page).encode()
    write_all(files)
    for path in files:
        say(f"{path}: written")
    return OK


def _final(
    archive: Archive, design: DoubleStroke, limits: Limits, final: str
) -> tuple[Outcome, tuple[Outcome, ...], Outcome]:
    """Return reference, front and chosen design of the outcomes on the final fields.

    Raises
    ------
    ValueError
        If the archive holds no reference or no design that keeps all limits.
    """
    from valve_twin.design.search.front import chosen_of, front_of
    from valve_twin.design.search.optimise import CHECK, apart_of
    from valve_twin.design.search.variables import value_of

    found = [of for of in archive if of.fidelity == final]
    own = [
        of
        for of in found
        if not of.error
        and all(abs(value_of(design, n) - v) <= 1e-5 * abs(v) for n, v in of.values.items())
    ]
    if not own:
        message = f"the archive holds no reference on the fields '{final}': let optimise end"
        raise ValueError(message)
    apart = apart_of(found, archive, final)
    front = front_of([of for of in found if of not in apart], limits, own[0].figures)
    if not front:
        message = f"none of {len(found)} designs on the fields '{final}' keeps all limits"
        if apart:
            message += f"; {len(apart)} have other figures on the fields '{CHECK}'"
        raise ValueError(message)
    return own[0], front, chosen_of(front, own[0].figures)


def _side(name: str, design: DoubleStroke, arguments: argparse.Namespace) -> Side:
    """Evaluate a design once more and draw it."""
    from valve_twin.core.valves.designed import find_designable
    from valve_twin.design.chain import evaluate, find_fidelity
    from valve_twin.design.field import draw_field, make_model, solve_field
    from valve_twin.design.geometry import draw_section
    from valve_twin.design.search.optimise import CHECK, CHECKED
    from valve_twin.report.coenergy import draw_coenergy
    from valve_twin.report.design.page import Side
    from valve_twin.report.loop import draw_loops

    shown = CHECK if arguments.final == CHECKED else arguments.final  # alike, and computed sooner
    of, valve = find_fidelity(shown), find_designable(arguments.valve)
    with progress_of(f"{name}: fields", None) as advance:
        found: Evaluation = evaluate(design, valve, fidelity=of, advance=advance)
    section = design.section()
    field = solve_field(make_model(section, of.fine), [_CURRENT, 0.0])
    return Side(
        name,
        draw_section(section),
        draw_field(field),
        draw_coenergy(found.designed.curves),
        draw_loops(found.loops),
    )


def _effects(
    arguments: argparse.Namespace, design: DoubleStroke, archive: Archive
) -> list[tuple[str, str, Table, str]]:
    from valve_twin.report.tables import Table

    middle, effects, indices = run_study(arguments, design, archive)
    failed = [f"{of.name}: {of.error}." for of in effects if of.error]
    share = 100 * (arguments.share or 0.05)
    remark = f"Every number {share:g} % lower and higher, one at a time; the stroke is kept. "
    found = [
        (
            "Sensitivities of the reference",
            picture_of(middle, effects),
            Table(*effect_rows(middle, effects)),
            remark + " ".join(failed),
        )
    ]
    if indices:
        refused = " ".join(f"{of.figure}: {of.refused}." for of in indices if of.refused)
        remark = (
            "Shares of the variance when all numbers vary together, on a surrogate; 'told' is the "
            f"share of the variance of designs it has not seen. {refused}"
        )
        found.append(("Sobol' indices", "", Table(*index_rows(indices)), remark))
    return found


def _picture(
    tried: Sequence[object], front: Sequence[Outcome], reference: Outcome, chosen: Outcome
) -> str:
    from valve_twin.report.design.front import draw_front

    points = {
        "tried": tried,
        "front": [of.figures for of in front],
        "reference": [reference.figures],
        "chosen": [chosen.figures],
    }
    return draw_front(_AXES, points)  # type: ignore[arg-type]


def _figure_row(name: str, of: Outcome) -> list[str]:
    return [name, *(number(factor * of.figures[key], form) for key, _, factor, form in COLUMNS)]


def _numbers(design: DoubleStroke, better: DoubleStroke, chosen: Outcome) -> Table:
    from valve_twin.core.quantity import describe
    from valve_twin.design.search.variables import value_of
    from valve_twin.report.tables import Table

    known = {d.name: d for d in describe(design)}
    names = [*chosen.values, *(["stroke_ratio"] if "stroke_ratio" not in chosen.values else [])]
    rows = [
        [name, known[name].unit, f"{value_of(design, name):.5g}", f"{value_of(better, name):.5g}",
         known[name].text]
        for name in names
    ]  # fmt: skip
    return Table(["number", "unit", "reference", "chosen", "what it is"], rows)


def _summary(reference: Outcome, chosen: Outcome, front: Sequence[Outcome]) -> str:
    words = [
        f"{label} {100 * (chosen.figures[key] / reference.figures[key] - 1):+.0f} %"
        for key, label in (("rise_s", "rise"), ("settling_s", "settling"), ("loss", "loss"))
    ]
    return (
        f"The chosen one of {len(front)} designs of the front against the reference: "
        f"{', '.join(words)}, largest overshoot {100 * chosen.figures['overshoot']:.1f} % "
        f"(reference {100 * reference.figures['overshoot']:.1f} %)."
    )


def _notes(archive: Archive, final: str) -> list[str]:
    from valve_twin import __version__

    kinds: dict[str, int] = {}
    for of in archive:
        kinds[of.fidelity] = kinds.get(of.fidelity, 0) + 1
    counted = ", ".join(f"{n} on the fields '{kind}'" for kind, n in kinds.items())
    failed = sum(bool(of.error) for of in archive)
    spent = sum(of.cpu_s for of in archive)
    return [
        f"The archive holds {counted}; {failed} failed; {spent:.0f} s of CPU time. The front is "
        f"that of the fields '{final}'.",
        "Every number that the geometry's file marks so is assumed. Not modelled: hysteresis, "
        "three dimensions, the flow's force on the spool, bounce.",
        f"valve_twin {__version__}",
    ]
