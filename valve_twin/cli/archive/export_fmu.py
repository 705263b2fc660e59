# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin export-fmu`: a valve of a history as a Functional Mock-up Unit."""

from __future__ import annotations

import argparse
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.cli.archive.fleet import aging_rules
from valve_twin.cli.common import (
    OK,
    add_url,
    add_verb,
    check_writable,
    cycle_number,
    positive,
    positive_number,
    progress_of,
    say,
    seed_number,
)
from valve_twin.io.whole import write_whole

if TYPE_CHECKING:
    from valve_twin.cli.common import Verbs
    from valve_twin.core.types import Estimate
    from valve_twin.gateway.fmu.parameter_sets import ParameterSet
    from valve_twin.gateway.fmu.valve import FmuValve
    from valve_twin.io.history.store import History

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
    sets = parser.add_argument_group("parameter sets beside it, as SSV")
    sets.add_argument(
        "--aged-to", type=_date, metavar="DATE", help="as its trends say it will be at YYYY-MM-DD"
    )
    sets.add_argument(
        "--draws",
        type=positive,
        default=0,
        metavar="N",
        help="drawn from the 95 %% intervals and how errors of its estimates go together",
    )
    sets.add_argument("--seed", type=seed_number, default=0, metavar="N", help="of the draws")
    sets.add_argument(
        "--config", metavar="FILE", help="YAML of the valve for its rules of aging, default usual"
    )


def _date(text: str) -> datetime:
    try:
        return datetime.strptime(text, "%Y-%m-%d").replace(tzinfo=timezone.utc)
    except ValueError:
        msg = f"'{text}' is refused: write a date as YYYY-MM-DD"
        raise argparse.ArgumentTypeError(msg) from None


def _export(arguments: argparse.Namespace) -> int:
    from valve_twin.gateway.fmu.export import write_fmu
    from valve_twin.gateway.fmu.parameter_sets import ssv
    from valve_twin.gateway.fmu.valve import stored_estimate, valve_of
    from valve_twin.io.history.store import History

    versions = _VERSIONS[arguments.fmi]
    out = Path(arguments.out)
    names = {v: out.with_stem(f"{out.stem}_fmi{v}") for v in versions}
    if len(versions) == 1:
        names = {versions[0]: out}
    check_writable(*map(str, names.values()))
    name = "/" + arguments.valve.strip("/")
    with History(arguments.url, read_only=True) as history:
        estimate, record = stored_estimate(history, name, arguments.cycle)
        valve = valve_of(history.where, name, estimate, record, arguments.period)
        sets = _sets(arguments, history, valve, estimate)
    text = "compiling; the first time the C libraries too, a minute or two"
    with progress_of(text, len(names)) as advance:
        for version, path in names.items():
            write_fmu(valve, path, version)
            advance()
    for version, path in names.items():
        say(f"{path}: FMI {version}.0, {valve.text}")
    for one in sets:
        path = out.with_name(f"{out.stem}_{one.name}.ssv")
        write_whole(path, ssv(valve, one))
    if sets:
        say(f"{out.parent / out.stem}_*.ssv: {len(sets)} parameter sets")
    return OK


def _sets(
    arguments: argparse.Namespace, history: History, valve: FmuValve, estimate: Estimate
) -> list[ParameterSet]:
    from valve_twin.core.aging.config import AgingConfig
    from valve_twin.gateway.fmu.parameter_sets import PAST, aged_set, draw_sets
    from valve_twin.gateway.fmu.valve import law_of
    from valve_twin.io.history.fleet import describe_valve

    law, sets = law_of(estimate.model).law, []
    if arguments.aged_to:
        name = "/" + arguments.valve.strip("/")
        rules = aging_rules(arguments.config).get(name, AgingConfig())
        trends = describe_valve(history, name, rules).trends
        aged, lines = aged_set(valve, law, trends, arguments.aged_to)
        sets.append(aged)
        for line in lines:
            say(f"{arguments.aged_to:%Y-%m-%d}: {line}")
    if arguments.draws:
        first = max(estimate.cycle - PAST, 1)
        past = history.estimates("/" + arguments.valve.strip("/"), estimate.estimator, first)
        past = [e for e in past if e.cycle <= estimate.cycle]
        sets += draw_sets(valve, law, estimate, arguments.draws, arguments.seed, past)
    return sets
