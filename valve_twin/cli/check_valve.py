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
from valve_twin.core.valves.registry import get_model

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


def _check(arguments: argparse.Namespace) -> int:
    try:
        get_model(arguments.name)
    except ValueError as err:
        return fail(f"check-valve: model {err}", USAGE)
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
