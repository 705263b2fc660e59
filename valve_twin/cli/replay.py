# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin replay`: a bag onto ROS topics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.cli.common import add_bag, add_verb, rate_number
from valve_twin.io.errors import ValveTwinError

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs,
        "replay",
        "Play a bag onto ROS topics, under /replay unless told otherwise; needs ROS 2.",
        _replay,
    )
    add_bag(parser)
    parser.add_argument(
        "--rate",
        type=rate_number,
        default=1.0,
        metavar="R",
        help="playback seconds a second, 0 = as fast as the subscribers take it",
    )
    parser.add_argument(
        "--prefix", default="/replay", metavar="NAME", help="put before every topic"
    )
    parser.add_argument("--clock", action="store_true", help="publish /clock")


def _replay(arguments: argparse.Namespace) -> int:
    try:
        from valve_twin.nodes.bag_player import play
    except ImportError as err:
        msg = f"replay needs ROS 2 ({err}); source it or use tools/run, or estimate offline"
        raise ValveTwinError(msg) from err
    return play(arguments.bag, rate=arguments.rate, prefix=arguments.prefix, clock=arguments.clock)
