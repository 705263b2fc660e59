# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin replay`: a bag onto ROS topics; options are named as those of `ros2 bag play`."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING

from valve_twin.cli.common import add_bag, add_verb, rate_number
from valve_twin.io.errors import ValveTwinError

if TYPE_CHECKING:
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
        "-r",
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
    _add_clock(parser)
    _add_window(parser)
    _add_topics(parser)
    _add_safety(parser)


def _add_clock(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--clock-hz",
        type=_seconds,
        default=0.0,
        metavar="HZ",
        help="publish /clock so often instead of before every message",
    )
    parser.add_argument(
        "--clock-topics",
        nargs="+",
        default=[],
        metavar="TOPIC",
        help="publish /clock before messages of these only",
    )


def _add_window(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--start-offset", type=_seconds, default=0.0, metavar="S", help="begin so much later [s]"
    )
    parser.add_argument(
        "--playback-duration",
        type=_seconds,
        default=0.0,
        metavar="S",
        help="bag time to play, 0 = to the end [s]",
    )
    until = parser.add_mutually_exclusive_group()
    until.add_argument(
        "--playback-until-sec",
        type=_seconds,
        default=0.0,
        metavar="S",
        help="log time to stop at [s]",
    )
    until.add_argument(
        "--playback-until-nsec", type=int, default=0, metavar="NS", help="the same in [ns]"
    )
    parser.add_argument(
        "-d",
        "--delay",
        type=_seconds,
        default=0.0,
        metavar="S",
        help="pause before playing, before every loop too [s]",
    )
    parser.add_argument("-l", "--loop", action="store_true", help="begin again at the end")
    parser.add_argument(
        "-p", "--start-paused", action="store_true", help="wait for the service resume"
    )
    parser.add_argument(
        "--wait-for-all-acked",
        type=_seconds,
        default=5000.0,
        metavar="MS",
        help="longest wait for acknowledgement at the end [ms]",
    )


def _add_topics(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--topics", nargs="+", default=[], metavar="TOPIC", help="play these, default all"
    )
    parser.add_argument(
        "-e", "--regex", default="", metavar="EXPR", help="play those whose name it is found in"
    )
    parser.add_argument(
        "--exclude-topics", nargs="+", default=[], metavar="TOPIC", help="do not play these"
    )
    parser.add_argument(
        "-x", "--exclude-regex", default="", metavar="EXPR", help="nor those it is found in"
    )
    parser.add_argument(
        "-m",
        "--remap",
        nargs="+",
        default=[],
        metavar="OLD:=NEW",
        help="new names before the prefix is put",
    )
    parser.add_argument(
        "--qos-profile-overrides-path", default="", metavar="FILE", help="YAML of policies"
    )


def _add_safety(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--wait-for-subscribers",
        type=int,
        default=0,
        metavar="N",
        help="begin when every topic has so many",
    )
    parser.add_argument(
        "--allow-live",
        action="store_true",
        help="publish also where somebody else publishes or takes commands: moves real valves",
    )


def _seconds(text: str) -> float:
    """Read a number that is not negative."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value < math.inf:
        msg = f"'{text}' is no number of at least 0"
        raise argparse.ArgumentTypeError(msg)
    return value


def _replay(arguments: argparse.Namespace) -> int:
    try:
        from valve_twin.nodes.player.node import play
    except ImportError as err:
        msg = f"replay needs ROS 2 ({err}); source it or use tools/run, or estimate offline"
        raise ValveTwinError(msg) from err
    return play(
        arguments.bag,
        rate=arguments.rate,
        prefix=arguments.prefix,
        clock=arguments.clock or bool(arguments.clock_hz or arguments.clock_topics),
        more=_parameters(arguments),
    )


def _parameters(arguments: argparse.Namespace) -> dict[str, object]:
    """Return the player's parameters of what was given."""
    until_ns = arguments.playback_until_nsec or round(arguments.playback_until_sec * 1e9)
    values: dict[str, object] = {
        "clock_hz": arguments.clock_hz,
        "clock_topics": arguments.clock_topics,
        "start_offset_s": arguments.start_offset,
        "duration_s": arguments.playback_duration,
        "until_ns": until_ns,
        "delay_s": arguments.delay,
        "loop": arguments.loop,
        "start_paused": arguments.start_paused,
        "acked_wait_s": arguments.wait_for_all_acked * 1e-3,
        "topics": arguments.topics,
        "regex": arguments.regex,
        "exclude_topics": arguments.exclude_topics,
        "exclude_regex": arguments.exclude_regex,
        "remap": arguments.remap,
        "qos_overrides_path": arguments.qos_profile_overrides_path,
        "wait_for_subscribers": arguments.wait_for_subscribers,
        "allow_live": arguments.allow_live,
    }
    return {name: value for name, value in values.items() if value or name == "acked_wait_s"}
