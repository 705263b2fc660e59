# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin info`: what a bag holds, and what is damaged in it."""

from __future__ import annotations

import json
import logging
from typing import TYPE_CHECKING

from valve_twin.cli.common import FAILED, OK, add_bag, add_verb
from valve_twin.cli.output import write

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs,
        "info",
        "Say what a bag holds: topics, types, counts, rates, QoS, own values, damage.",
        _info,
    )
    add_bag(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument(
        "--verify", action="store_true", help="read every chunk, not the summaries only"
    )


def _info(arguments: argparse.Namespace) -> int:
    from valve_twin.io.bags.report import bag_report, report_lines

    logger = logging.getLogger("valve_twin")
    before = logger.level
    logger.setLevel(logging.ERROR)  # the damage is part of the report
    try:
        report = bag_report(arguments.bag, verify=arguments.verify)
    finally:
        logger.setLevel(before)
    lines = [json.dumps(report)] if arguments.json else report_lines(report)
    write("".join(f"{line}\n" for line in lines))
    return FAILED if report["damaged"] else OK
