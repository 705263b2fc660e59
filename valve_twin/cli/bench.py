# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin bench`: speed against what a user would write otherwise."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from valve_twin.cli.common import FAILED, OK, USAGE, add_verb, fail
from valve_twin.core.quantity import suggest

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs, "bench", "Measure against what a user would write otherwise, in one run.", _bench
    )
    parser.add_argument(
        "area", nargs="*", metavar="AREA", help="only these, e.g. reading; default all"
    )
    parser.add_argument("--quick", action="store_true", help="seconds instead of minutes")
    parser.add_argument(
        "--gate",
        action="store_true",
        help="five runs on a quiet machine; exit code 1 where a committed ratio was lost",
    )


def _bench(arguments: argparse.Namespace) -> int:
    from valve_twin.bench import AREAS, run_benchmarks, run_gate

    for area in arguments.area:
        if area not in AREAS:
            return fail(f"bench: there is no area '{area}'; {suggest(area, AREAS)}", USAGE)
    try:
        if arguments.gate:
            kept = run_gate(quick=arguments.quick, write=sys.stdout.write, areas=arguments.area)
            return OK if kept else FAILED
        run_benchmarks(quick=arguments.quick, write=sys.stdout.write, areas=arguments.area)
    except ModuleNotFoundError as err:
        return fail(f"bench: {err.name}, which is compared with, is missing: install it", FAILED)
    return OK
