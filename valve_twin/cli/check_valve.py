# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin check-valve`: whether a valve keeps what the house expects of one."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from time import perf_counter
from typing import TYPE_CHECKING

from valve_twin.cli.common import FAILED, OK, USAGE, add_verb, fail, positive
from valve_twin.core.valves.check import SEEDS, check_valve
from valve_twin.core.valves.registry import get_model, get_simulation
from valve_twin.core.valves.strangers import DRAWN, SEED_BASE, Score, score_strangers

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs

_WORDS = {True: "pass", False: "FAIL", None: "-"}


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs,
        "check-valve",
        "Check that a valve, ours or a user's, keeps its protocol; ends with 1 if it does not.",
        _check,
    )
    parser.add_argument("name", metavar="NAME", help="name of a registered valve model")
    parser.add_argument(
        "--seeds",
        type=positive,
        default=SEEDS,
        help=f"simulated records whose intervals are counted, default {SEEDS}",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object a check")
    parser.add_argument(
        "--strangers",
        action="store_true",
        help="instead: a table of valves that are not as the options say, in Markdown",
    )
    parser.add_argument(
        "--seed-base",
        type=int,
        default=SEED_BASE,
        help="first seed of the strangers; those of the default are never tuned on",
    )
    parser.add_argument(
        "--only",
        metavar="NAME",
        nargs="+",
        default=[""],
        help="strangers whose names begin so, with the seeds that they have among all",
    )


def _check(arguments: argparse.Namespace) -> int:
    try:
        get_model(arguments.name)
    except ValueError as err:
        return fail(f"check-valve: model {err}", USAGE)
    if arguments.strangers:
        try:
            get_simulation(arguments.name)
        except ValueError as err:
            return fail(f"check-valve: {err}", USAGE)
        return _strangers(arguments)
    failed = False
    for found in check_valve(arguments.name, perf_counter, seeds=arguments.seeds):
        failed |= found.passed is False
        line = (
            json.dumps(asdict(found))
            if arguments.json
            else (f"{_WORDS[found.passed]:4}  {found.check:20} {found.text}")
        )
        sys.stdout.write(f"{line}\n")
        sys.stdout.flush()
    return FAILED if failed else OK


def _strangers(arguments: argparse.Namespace) -> int:
    """Print the table of strangers; those with drawn constants are one row."""
    drawn: list[Score] = []
    if not arguments.json:
        sys.stdout.write("| stranger | inside | outside | withheld | worst outside |\n")
        sys.stdout.write("| --- | --- | --- | --- | --- |\n")
    scored = score_strangers(
        arguments.name,
        drawn=arguments.seeds,
        seed_base=arguments.seed_base,
        only=tuple(arguments.only),
    )
    for score in scored:
        if arguments.json:
            sys.stdout.write(f"{json.dumps(asdict(score))}\n")
        elif score.name == DRAWN:
            drawn.append(score)
        else:
            _row(score)
        sys.stdout.flush()
    if drawn:
        whole = Score(
            f"{DRAWN}, {len(drawn)} valves",
            sum(s.inside for s in drawn),
            sum(s.outside for s in drawn),
            sum(s.withheld for s in drawn),
            "",
        )
        _row(whole)
    return OK


def _row(score: Score) -> None:
    counts = f"{score.inside} | {score.outside} | {score.withheld}"
    sys.stdout.write(f"| {score.name} | {counts} | {score.wrong} |\n")
