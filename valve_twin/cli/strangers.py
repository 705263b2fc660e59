# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin campaign --strangers`: presses of another hand, shown to the twin and scored."""

from __future__ import annotations

import json
import statistics
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, TypeVar

from valve_twin.cli.common import OK, USAGE, fail, positive, progress_of, seed_number
from valve_twin.cli.output import console, plain, table
from valve_twin.core.valves.registry import get_model
from valve_twin.io.config.valve import load_config, parse_config
from valve_twin.io.offline.make_twin import twin_config
from valve_twin.io.whole import write_whole

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterator

    from valve_twin.validation.strangers.campaign import Met, Scored
    from valve_twin.validation.strangers.early import FirstCycles
    from valve_twin.validation.strangers.score import Score
    from valve_twin.validation.strangers.watch import Setup


M = TypeVar("M", bound="Scored")

PRESS, ANY = "press", "any"
"""Families of strangers."""


def add_strangers(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument(
        "--strangers",
        nargs="?",
        const=PRESS,
        choices=(PRESS, ANY),
        help="instead show random valves of another program to the twin and score what it says: "
        "presses (default), or any, whose twins are as `configure` proposes",
    )
    parser.add_argument(
        "--seed-base",
        type=seed_number,
        metavar="N",
        help="first seed of the strangers; default the scored ones, on which nothing is tuned",
    )
    parser.add_argument(
        "--count",
        type=positive,
        metavar="K",
        help="how many strangers, default 200 presses, 12 of any, 40 with --with-reference",
    )
    parser.add_argument(
        "--with-reference",
        type=positive,
        metavar="SISTERS",
        help="instead judge the first cycles of presses, sound and with early faults, with and "
        "without a reference that so many sisters made",
    )


def setup_of(path: str | None) -> Setup:
    """Return how the twin is configured: as shipped, or by the file of a valve.

    Raises
    ------
    ConfigError
        If the file cannot be used.
    """
    from valve_twin.validation.strangers.watch import AS_SHIPPED, Setup

    config = load_config(path)[0] if path else parse_config(AS_SHIPPED, "as shipped")[0]
    return Setup(twin_config(config, get_model(config.model)), config.aging)


def run_strangers(arguments: argparse.Namespace) -> int:
    """Meet the strangers, print the table and write the figures."""
    if arguments.strangers == ANY:
        if arguments.with_reference:
            return fail("campaign: --with-reference is for --strangers press", USAGE)
        from valve_twin.cli.bags.any_strangers import configured, described
        from valve_twin.validation.any_strangers import campaign as any_valve

        scored = any_valve.SCORED_BASE, any_valve.SCORED_COUNT
        _campaign(arguments, scored, partial(any_valve.meet, configured=configured), described)
    elif arguments.with_reference:
        from valve_twin.validation.strangers import early

        setup = setup_of(arguments.config)
        scored = early.REFERENCE_BASE, early.REFERENCE_COUNT
        meet = partial(early.meet_families, setup=setup, sisters=arguments.with_reference)
        _campaign(arguments, scored, meet, _family_described)
    else:
        from valve_twin.validation.strangers import campaign as press

        setup = setup_of(arguments.config)
        scored = press.SCORED_BASE, press.SCORED_COUNT
        _campaign(arguments, scored, partial(press.meet, setup=setup), _described)
    return OK


def _campaign(
    arguments: argparse.Namespace,
    scored: tuple[int, int],
    meet: Callable[..., Iterator[M]],
    described: Callable[[M], dict[str, object]],
) -> None:
    """Meet the strangers of a family; `scored` is where its seeds begin and how many there are."""
    from valve_twin.validation.strangers.campaign import pooled, seeds

    base, count = scored
    chosen = seeds(
        base if arguments.seed_base is None else arguments.seed_base, arguments.count or count
    )
    with progress_of("strangers", len(chosen)) as advance:
        met = list(meet(chosen, advance=advance))
    whole = pooled(met)
    _show(whole)  # also where the file cannot be written: it took hours
    if arguments.json:
        figures = {
            "seeds": list(chosen),
            "shares": whole.shares,
            "delays": whole.delays,
            "strangers": [described(m) for m in met],
        }
        text = json.dumps(figures, indent=1, allow_nan=False)
        write_whole(arguments.json, f"{text}\n")


def _described(met: Met) -> dict[str, object]:
    """Return what was told of a press as plain data."""
    found = {
        "seed": met.stranger.seed,
        "verdicts": met.score.words,
        "aging": asdict(met.stranger.aging),
        "logger": asdict(met.stranger.logger),
        "recipes": "".join(map(str, met.stranger.recipe_of)),
        "troubles": [asdict(t) for t in met.stranger.troubles],
        "shares": met.score.shares,
    }
    return {name: plain(value) for name, value in found.items()}


def _family_described(met: FirstCycles) -> dict[str, object]:
    """Return what was told of the first cycles of a press as plain data."""
    found = {
        "seed": met.family.seed,
        "sisters": len(met.family.sisters),
        "refused": met.refused,
        "words": met.words,
        "troubles": [asdict(t) for t in met.family.troubles],
        "why": dict(met.why),
        "shares": met.score.shares,
    }
    return {name: plain(value) for name, value in found.items()}


def _show(whole: Score) -> None:
    """Print every share."""
    shown = table("Strangers", ("figure",), ("hits", "cases", "share"))
    for name, (hits, cases) in sorted(whole.shares.items()):
        shown.add_row(name, f"{hits:.0f}", f"{cases:.0f}", f"{100.0 * hits / cases:.1f} %")
    out = console()
    out.print(shown)
    if not whole.delays:
        return
    found = [d for d in whole.delays if d]
    median = f"{statistics.median(found):.1f}" if found else "-"
    out.print(
        f"{len(found)} of {len(whole.delays)} medium and large faults found, "
        f"median delay {median} cycles",
        highlight=False,
    )
