# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin cut`: write a part of a bag as a bag of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.cli.common import OK, add_bag, add_config, add_verb, chosen_config
from valve_twin.cli.output import write
from valve_twin.io.errors import ConfigError

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs

_TIME = "seconds after the begin of the bag, or a time such as 2026-01-31T08:00:00Z"


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(verbs, "cut", "Write a span of time of a bag into a new bag.", _cut)
    add_bag(parser)
    parser.add_argument("--out", required=True, metavar="NEW", help="bag folder to make")
    parser.add_argument("--from", dest="begin", default="", metavar="TIME", help=_TIME)
    parser.add_argument("--to", dest="end", default="", metavar="TIME", help=_TIME)
    parser.add_argument("--topics", nargs="+", default=[], metavar="TOPIC", help="only these")
    parser.add_argument(
        "--cycles", default="", metavar="N..M", help="these cycles instead; needs --config"
    )
    add_config(parser, "YAML of the valve, for --cycles")


def _cut(arguments: argparse.Namespace) -> int:
    from valve_twin.io.bags.contents import bag_info, compare_with_data
    from valve_twin.io.offline.cut import cut, cycles_span, read_time

    compare_with_data(arguments.bag)
    info = bag_info(arguments.bag)
    if arguments.cycles:
        if not arguments.config or arguments.begin or arguments.end:
            msg = "--cycles needs --config FILE and neither --from nor --to"
            raise ConfigError(msg)
        begin, end = cycles_span(arguments.bag, chosen_config(arguments), arguments.cycles)
    else:
        begin = read_time(arguments.begin or "0", info.start_ns, "--from")
        end = info.end_ns
        if arguments.end:
            end = read_time(arguments.end, info.start_ns, "--to")
    if end < begin:
        msg = f"--to {arguments.end} lies before --from {arguments.begin}; exchange them"
        raise ConfigError(msg)
    found = cut(arguments.bag, arguments.out, from_ns=begin, until_ns=end, topics=arguments.topics)
    topics = ", ".join(f"{name} ({n})" for name, n in sorted(found.topics.items()))
    held = f"; {found.latched} latched from before the cut" if found.latched else ""
    total = sum(found.topics.values())
    write(f"{found.out}: {total} messages written and verified: {topics}{held}\n")
    return OK
