# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin verify`: make a report page again from its input and compare to the last bit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.cli.common import (
    FAILED,
    OK,
    USAGE,
    add_config,
    add_url,
    add_verb,
    chosen_config,
    fail,
    run_offline,
    say,
)
from valve_twin.cli.output import write

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs
    from valve_twin.core.valves.error_budget import Budget
    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.report.data import ReportData
    from valve_twin.report.provenance.page import WrittenPage


def add(verbs: Verbs) -> None:
    """Add the verb."""
    text = "Make a report page again from its input and compare to the last bit."
    parser = add_verb(verbs, "verify", text, _verify)
    parser.add_argument("report", metavar="REPORT", help="page that valve-twin report wrote")
    parser.add_argument("--bag", default="", metavar="BAG", help="its bag, where that was moved")
    add_url(parser, required=False)
    add_config(parser, "compare with this YAML of the valve, default what the page carries")


def _verify(arguments: argparse.Namespace) -> int:
    from valve_twin.report.provenance.page import read_page
    from valve_twin.report.provenance.recompute import compare_report
    from valve_twin.report.provenance.record import BAG

    report = read_page(arguments.report)
    then = report.provenance
    of_bag = then.origin.kind == BAG
    if arguments.bag and arguments.url:
        return fail("verify: give --bag or --url, not both", USAGE)
    if arguments.url if of_bag else arguments.bag:
        wanted, given = ("--bag", "--url") if of_bag else ("--url", "--bag")
        kind = then.origin.kind
        return fail(f"{report.where}: was made from a {kind}: give {wanted}, not {given}", USAGE)
    if arguments.valve and not arguments.config:
        return fail("verify: --valve chooses from a file: give --config as well", USAGE)
    if arguments.config:
        arguments.valve = arguments.valve or then.valve
        config = chosen_config(arguments)
    else:
        config = then.config(report.where)
    where = arguments.bag or arguments.url or _found(report, given="--bag" if of_bag else "--url")
    if not where:
        return FAILED
    data = _bag_again if of_bag else _history_again
    found = compare_report(report, config, data(report, config, where), where)
    return _tell(report, where, found.changed, found.versions)


def _found(report: WrittenPage, given: str) -> str:
    """Return where the input is that a page names: as it was given, or beside the page."""
    origin = report.provenance.origin
    beside = Path(report.where).parent / Path(origin.where).name
    if "://" in origin.where or Path(origin.where).exists():
        return origin.where
    if beside.exists():
        return str(beside)
    fail(f"{report.where}: its {origin.kind} {origin.where} is not there; give it with {given}")
    return ""


def _bag_again(report: WrittenPage, config: ValveConfig, bag: str) -> ReportData:
    from valve_twin.report.build import bag_data

    record, assessment = run_offline(config, bag, close_last=True)
    budget = _budget_again(report, config)
    return bag_data(config, bag, record, assessment, report.provenance.label, budget=budget)


def _history_again(report: WrittenPage, config: ValveConfig, url: str) -> ReportData:
    from valve_twin.report.build import configured_history_data

    budget = _budget_again(report, config)
    there = replace(config, history_url=url)
    return configured_history_data(there, report.provenance.label, budget=budget)


def _budget_again(report: WrittenPage, config: ValveConfig) -> Budget | None:
    if not report.provenance.budget:
        return None
    from valve_twin.io.offline.budget import configured_budget

    return configured_budget(config)


def _tell(report: WrittenPage, where: str, changed: list[str], versions: list[str]) -> int:
    if changed:
        write("".join(f"{line}\n" for line in [*changed, *versions]))
        return fail(f"{report.where}: differs from what {where} gives now")
    for line in versions:
        say(f"valve-twin: {line}: the page is the same")
    origin = report.provenance.origin
    counted = ", ".join(f"{name} {part.count}" for name, part in origin.parts.items())
    write(f"{report.where}: made again from {where} ({counted}): equal in every bit\n")
    return OK
