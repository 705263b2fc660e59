# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design holding`: static force of a hybrid pole, and what each dimension does."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from valve_twin.cli.common import (
    OK,
    add_verb,
    check_writable,
    progress_of,
    say,
    share_number,
    write_file,
)
from valve_twin.cli.design.field import add_fine
from valve_twin.cli.design.given import add_design, read_given, refusals
from valve_twin.cli.output import console, number, plain, print_json, table
from valve_twin.io.errors import ConfigError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Mapping, Sequence

    from valve_twin.cli.common import Verbs
    from valve_twin.core.types import FloatArray
    from valve_twin.design.geometry import HybridPole
    from valve_twin.design.holding import Effect


def add(steps: Verbs) -> None:
    """Add the step."""
    text = "Compute the force of a hybrid pole, and what each of its dimensions does to it."
    parser = add_verb(steps, "holding", text, _holding)
    add_design(parser, "the pole of paper 001")
    parser.add_argument(
        "--of", action="append", default=[], metavar="NAME", help="a number, default all"
    )
    parser.add_argument(
        "--share", type=share_number, metavar="X", help="change up and down [1], default 0.1"
    )
    add_fine(parser)
    parser.add_argument("--svg", metavar="FILE", help="picture to write")
    parser.add_argument("--json", action="store_true", help="one JSON object")


def _holding(arguments: argparse.Namespace) -> int:
    check_writable(arguments.svg)
    pole = _pole(arguments)
    from valve_twin.design.holding import GAPS, SHARE, STUDIED, UNPRINTED, holding_forces, study

    share, fine = arguments.share or SHARE, arguments.fine
    names = tuple(arguments.of) or (*STUDIED, *UNPRINTED)
    with refusals():
        with progress_of("over the gap", len(GAPS)) as advance:
            forces = {}
            for gap in GAPS:
                forces[gap] = holding_forces(pole, gap, fine=fine)
                advance()
        with progress_of("one at a time", len(names)) as advance:
            effects = study(pole, names, share, fine, advance)
    base = forces[GAPS[0]]
    if arguments.svg:
        write_file(arguments.svg, _picture(effects, base))
    if arguments.json:
        print_json(_as_json(forces, effects))
        return OK
    _show_forces(forces)
    _show_effects(effects, base, share)
    return OK


def _pole(arguments: argparse.Namespace) -> HybridPole:
    """Return the pole of the arguments.

    Raises
    ------
    ConfigError
        If it is another solenoid, or the gap is set.
    """
    if any(pair.partition("=")[0].strip() == "gap" for pair in arguments.set):
        msg = "--set gap: this step takes gaps from 0.5 to 4 mm; design field takes a gap"
        raise ConfigError(msg)
    design = read_given(arguments, "hybrid_pole")
    from valve_twin.design.geometry import HybridPole

    if not isinstance(design, HybridPole):
        msg = f"{arguments.design}: kind must be hybrid_pole: this step changes its dimensions"
        raise ConfigError(msg)
    return design


def _show_forces(forces: Mapping[float, FloatArray]) -> None:
    from valve_twin.design.holding import PUBLISHED, TURNS

    head = [f"{turns:g} At" for turns in TURNS]
    shown = table("Force [N]; in brackets what paper 001 measured", ["gap"], head)
    for gap, row in forces.items():
        cells = []
        for turns, force in zip(TURNS, row, strict=True):
            known = PUBLISHED.get((gap, turns))
            cells.append(number(float(force), ".1f") + (f" ({known:g})" if known else ""))
        shown.add_row(f"{1e3 * gap:g} mm", *cells)
    console().print(shown)


def _show_effects(effects: Sequence[Effect], base: FloatArray, share: float) -> None:
    from valve_twin.design.holding import NEAR, STUDIED, TURNS

    head = [f"{turns:g} At, %" for turns in TURNS]
    title = f"Each number alone, {-100 * share:g} % / {100 * share:+g} %, at {1e3 * NEAR:g} mm"
    shown = table(f"{title}; what the paper says", ["number"], head, ["paper"])
    for of in effects:
        cells = ["/".join(number(100 * v, "+.1f") for v in pair) for pair in _changes(of, base)]
        told = STUDIED.get(of.name)
        words = "not printed" if told is None else f"{100 * told.effect:+.1f} %"
        if told is not None and told.by:
            words += f" for {1e3 * told.by:+g} mm"
        shown.add_row(of.name, *cells, words)
    console().print(shown)
    for of in effects:
        if of.error:
            say(f"{of.name}: {of.error}")


def _changes(of: Effect, base: FloatArray) -> list[tuple[float, float]]:
    """Return changes at the lower and the higher value by m.m.f. [1]."""
    return [(float(low / own - 1.0), float(high / own - 1.0))
            for low, high, own in zip(*of.forces, base, strict=True)]  # fmt: skip


def _picture(effects: Sequence[Effect], base: FloatArray) -> str:
    from valve_twin.design.holding import TURNS
    from valve_twin.report.design.effects import draw_effects

    rows = {of.name: [(100 * low, 100 * high) for low, high in _changes(of, base)]
            for of in effects}  # fmt: skip
    labels = [f"force at {turns:g} At" for turns in TURNS]
    return draw_effects(labels, rows, "%", ("lower", "higher"))


def _as_json(forces: Mapping[float, FloatArray], effects: Sequence[Effect]) -> dict[str, object]:
    from valve_twin.design.holding import TURNS

    return {
        "ampere_turns": list(TURNS),
        "force": {f"{gap:g}": row.tolist() for gap, row in forces.items()},
        "effects": [
            {
                "name": of.name,
                "values": list(of.values),
                "force": [[None if math.isnan(v) else plain(float(v)) for v in row]
                          for row in of.forces],
                "error": of.error,
            }
            for of in effects
        ],
    }  # fmt: skip
