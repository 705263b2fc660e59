# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin export-fmu`: a valve of a history as a Functional Mock-up Unit."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.cli.common import (
    OK,
    add_url,
    add_verb,
    check_writable,
    cycle_number,
    positive_number,
    say,
)

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs

_VERSIONS = {"2": (2,), "3": (3,), "both": (2, 3)}


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs,
        "export-fmu",
        "Write a valve with the values of a cycle as FMUs for co-simulation, without Python.",
        _export,
    )
    add_url(parser)
    parser.add_argument("--valve", required=True, metavar="NAME", help="valve of the history")
    parser.add_argument(
        "--cycle", type=cycle_number, default=0, metavar="N", help="default the newest usable one"
    )
    parser.add_argument("--fmi", choices=tuple(_VERSIONS), default="2", help="version, default 2")
    parser.add_argument(
        "--period",
        type=positive_number,
        default=0.0,
        metavar="SECONDS",
        help="sampling time, default that of the cycle's stamps",
    )
    parser.add_argument(
        "--out", required=True, metavar="FILE", help=".fmu; with both, FILE_fmi2 and FILE_fmi3"
    )


def _export(arguments: argparse.Namespace) -> int:
    from valve_twin.gateway.fmu.export import write_fmu
    from valve_twin.gateway.fmu.valve import stored_estimate, valve_of
    from valve_twin.io.history.store import History

    versions = _VERSIONS[arguments.fmi]
    out = Path(arguments.out)
    names = {v: out.with_stem(f"{out.stem}_fmi{v}") for v in versions}
    if len(versions) == 1:
        names = {versions[0]: out}
    for path in names.values():
        check_writable(str(path))
    with History(arguments.url, read_only=True) as history:
        estimate, record = stored_estimate(history, arguments.valve, arguments.cycle)
        name = "/" + arguments.valve.strip("/")
        valve = valve_of(history.where, name, estimate, record, arguments.period)
    for version, path in names.items():
        write_fmu(valve, path, version)
        say(f"{path}: FMI {version}.0, {valve.text}")
    return OK
