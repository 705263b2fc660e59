# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin report`: one self-contained HTML page."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.cli.common import (
    OK,
    add_config,
    add_verb,
    check_writable,
    chosen_config,
    no_cycle,
    run_offline,
    say,
)

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(verbs, "report", "Write one self-contained HTML page.", _report)
    parser.add_argument("bag", nargs="?", metavar="BAG", help="bag to estimate; else the history")
    add_config(parser)
    parser.add_argument("--out", required=True, metavar="HTML", help="page to write")
    parser.add_argument(
        "--label", default="", help="what the axis is where it is not aging, default aging.label"
    )
    parser.add_argument(
        "--budget", action="store_true", help="with the error budget of the simulated valve"
    )
    parser.add_argument("--language", default="en", choices=["en", "de"], help="of the page")


def _report(arguments: argparse.Namespace) -> int:
    from valve_twin.report.build import report_bag, report_history

    config = chosen_config(arguments)
    check_writable(arguments.out)
    budget = None
    if arguments.budget:
        from valve_twin.io.offline.budget import configured_budget

        budget = configured_budget(config)
    if arguments.bag:
        record, assessment = run_offline(config, arguments.bag, close_last=True)
        if not record.cycles:
            return no_cycle(config, arguments.bag)
        report_bag(
            config,
            arguments.bag,
            record,
            assessment,
            arguments.out,
            arguments.label,
            budget=budget,
            language=arguments.language,
        )
    else:
        report_history(
            config, arguments.out, arguments.label, budget=budget, language=arguments.language
        )
    say(f"{arguments.out}: written")
    return OK
