# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin replay`: a bag onto ROS topics; options are named as those of `ros2 bag play`."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from valve_twin.cli.common import add_bag, add_verb, rate_number
from valve_twin.io.errors import ValveTwinError

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs


class Option(NamedTuple):
    """One option: its names, what stands for its value, the player's parameter, its default.

    The type is that of the default; a list takes several values.
    """

    names: str
    value: str
    parameter: str
    default: float | str | list[str]
    text: str


_OPTIONS = (
    Option("-r --rate", "R", "", 1.0,
           "playback seconds a second, 0 = as fast as the subscribers take it"),
    Option("--prefix", "NAME", "", "/replay", "put before every topic"),
    Option("--clock", "", "", False, "publish /clock"),
    Option("--clock-hz", "HZ", "clock_hz", 0.0,
           "publish /clock so often instead of before every message"),
    Option("--clock-topics", "TOPIC", "clock_topics", [],
           "publish /clock before messages of these only"),
    Option("--start-offset", "S", "start_offset_s", 0.0, "begin so much later [s]"),
    Option("--playback-duration", "S", "duration_s", 0.0,
           "bag time to play, 0 = to the end [s]"),
    Option("--playback-until-sec", "S", "", 0.0, "log time to stop at [s]"),
    Option("--playback-until-nsec", "NS", "", 0, "the same in [ns]"),
    Option("-d --delay", "S", "delay_s", 0.0, "pause before playing, before every loop too [s]"),
    Option("-l --loop", "", "loop", False, "begin again at the end"),
    Option("-p --start-paused", "", "start_paused", False, "wait for the service resume"),
    Option("--wait-for-all-acked", "MS", "", 5000.0,
           "longest wait for acknowledgement at the end [ms]"),
    Option("--topics", "TOPIC", "topics", [], "play these, default all"),
    Option("-e --regex", "EXPR", "regex", "", "play those whose name it is found in"),
    Option("--exclude-topics", "TOPIC", "exclude_topics", [], "do not play these"),
    Option("-x --exclude-regex", "EXPR", "exclude_regex", "", "nor those it is found in"),
    Option("-m --remap", "OLD:=NEW", "remap", [], "new names before the prefix is put"),
    Option("--qos-profile-overrides-path", "FILE", "qos_overrides_path", "", "YAML of policies"),
    Option("--wait-for-subscribers", "N", "wait_for_subscribers", 0,
           "begin when so many nodes subscribe to every topic"),
    Option("--allow-live", "", "allow_live", False,
           "publish also where somebody else publishes or takes commands: moves real valves"),
)  # fmt: skip


def add(verbs: Verbs) -> None:
    """Add the verb."""
    text = "Play a bag onto ROS topics, under /replay unless --prefix says else; needs ROS 2."
    parser = add_verb(verbs, "replay", text, _replay)
    add_bag(parser)
    until = parser.add_mutually_exclusive_group()
    for option in _OPTIONS:
        where = until if "-until-" in option.names else parser
        names, default = option.names.split(), option.default
        if isinstance(default, bool):
            where.add_argument(*names, action="store_true", help=option.text)
            continue
        kind = rate_number if isinstance(default, float) else type(default)
        several = {"nargs": "+", "type": str} if isinstance(default, list) else {"type": kind}
        where.add_argument(
            *names, default=default, metavar=option.value, help=option.text, **several
        )


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
    until_s, until_ns = arguments.playback_until_sec, arguments.playback_until_nsec
    values: dict[str, object] = {"until_ns": until_ns or round(until_s * 1e9)}
    for option in _OPTIONS:
        if option.parameter:
            name = option.names.split("--")[1].replace("-", "_")
            values[option.parameter] = getattr(arguments, name)
    given = {name: value for name, value in values.items() if value}
    return {**given, "acked_wait_s": arguments.wait_for_all_acked * 1e-3}
