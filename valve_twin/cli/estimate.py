# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin estimate`: every cycle of a bag, one JSON object a line."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from valve_twin.cli.common import (
    OK,
    add_bag,
    add_config,
    add_freeze,
    add_verb,
    check_writable,
    chosen_config,
    fail,
    no_cycle,
    run_offline,
    say,
)
from valve_twin.cli.output import write
from valve_twin.io.whole import write_whole

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs, "estimate", "Estimate every cycle of a bag; one JSON object a line.", _estimate
    )
    add_bag(parser)
    add_config(parser)
    parser.add_argument("--json", metavar="OUT", help="file to write, default standard output")
    add_freeze(parser)
    parser.add_argument(
        "--closed-cycles-only",
        action="store_true",
        help="leave out the cycle in which the record ends, as the live node does",
    )


def _estimate(arguments: argparse.Namespace) -> int:
    from valve_twin.io.offline.baseline import compare_baselines
    from valve_twin.io.offline.doubtful import describe_use, is_doubtful
    from valve_twin.io.tables.json_lines import json_lines

    config = chosen_config(arguments)
    check_writable(arguments.json)
    record, assessment = run_offline(
        config,
        arguments.bag,
        close_last=not arguments.closed_cycles_only,
        predict=False,
        freeze_after=arguments.freeze,
    )
    lines = list(
        json_lines(record.estimates, assessment, config.name, record.counters, record.files)
    )
    baselines = compare_baselines(record)
    if baselines is not None:
        lines.append(json.dumps(baselines.fields(config.name), allow_nan=False))
        if baselines.worse:
            say(f"{arguments.bag}: {baselines.text}")
    text = "".join(f"{line}\n" for line in lines)
    if arguments.json:
        write_whole(arguments.json, text)
        verdict = assessment.verdict
        say(f"{arguments.json}: {describe_use(record)}; {verdict.text}: {verdict.evidence}")
    else:
        write(text)
    if not record.cycles:
        return no_cycle(config, arguments.bag)
    if is_doubtful(record, assessment):
        verdict = assessment.verdict
        return fail(
            f"{arguments.bag}: not to be relied on: {describe_use(record)}; {verdict.evidence}"
        )
    return OK
