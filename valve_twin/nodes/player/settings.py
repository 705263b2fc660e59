# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a player is to do, read from its parameters and checked against the bag once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.validate_full_topic_name import validate_full_topic_name

from valve_twin.io.bags.qos import FOREVER_NS, override, read_overrides
from valve_twin.io.bags.qos import QosProfile as OfferedQos
from valve_twin.io.cdr.message_types import message_class
from valve_twin.io.config.node_parameters import BagPlayerParameters
from valve_twin.io.config.topic_names import resolve_topic
from valve_twin.io.errors import ConfigError
from valve_twin.io.playback.choice import Choice, Stretch, read_remaps, stretch
from valve_twin.io.playback.player import BagTopic, bag_topics, compare_small
from valve_twin.nodes.player.outbox import DEPTH
from valve_twin.nodes.runtime.safety import is_free

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.nodes.runtime.parameters import Parameters

CLOCK = "/clock"


@dataclass(frozen=True, slots=True)
class PlayedTopic:
    """One topic on its way from the bag to the network.

    Attributes
    ----------
    topic : BagTopic
        As it is in the bag.
    name : str
        Under which it is published, before the node's own remappings.
    offer : OfferedQos
        Policies of its publisher.
    ticks : bool
        /clock goes before its messages.
    """

    topic: BagTopic
    name: str
    offer: OfferedQos
    ticks: bool


@dataclass(frozen=True, slots=True)
class PlaybackSettings:
    """What is played, and how.

    Attributes
    ----------
    topics : tuple of PlayedTopic
        By topic.
    whole, part : Stretch
        The bag, and what of it is wanted.
    given : BagPlayerParameters
        The parameters, without what has no effect beside others.
    """

    topics: tuple[PlayedTopic, ...]
    whole: Stretch
    part: Stretch
    given: BagPlayerParameters

    def part_from(self, offset_ns: int, duration_ns: int, until_ns: int) -> Stretch:
        """Return another part of the same bag.

        Parameters
        ----------
        offset_ns : int
            Begin this long after the first message [ns].
        duration_ns : int
            Bag time to play [ns], 0 or less = to the end.
        until_ns : int
            Log time to stop at [ns], 0 or less = the end. The earlier end counts.

        Raises
        ------
        BagError
            If nothing lies in it.
        """
        return stretch(
            self.given.bag, offset_ns=offset_ns, duration_ns=duration_ns, until_ns=until_ns
        )


def read_settings(
    parameters: Parameters,
    where: str,
    warn: Callable[[str], object],
    tell: Callable[[str], object] = lambda _: None,
) -> PlaybackSettings:
    """Return what the parameters ask for.

    Parameters
    ----------
    parameters : Parameters
        Of the player.
    where : str
        Name of the node, for messages.
    warn : callable
        Gets a line for each topic that cannot be played, or not under the name that is looked for.
    tell : callable
        Gets a line for each recorded prefix that gives way to the player's.

    Raises
    ------
    BagError
        If the bag cannot be read, lacks a wanted topic or nothing of it can be played.
    ConfigError
        If a parameter does not fit.
    """
    p = parameters.read(BagPlayerParameters)
    bag = p.bag
    if not bag:
        msg = f"{where}: key 'bag' is empty; write the folder of a bag"
        raise ConfigError(msg)
    bag = str(Path(bag).absolute())  # who asks from elsewhere knows no folder of ours
    p = replace(p, bag=bag)
    compare_small(bag)
    choice = Choice(
        topics=p.topics,
        regex=p.regex,
        exclude_topics=p.exclude_topics,
        exclude_regex=p.exclude_regex,
    )
    playable = [t for t in bag_topics(bag, choice) if _is_playable(t, warn)]
    topics = _topics(p, playable, _names(p, [t.name for t in playable], warn, tell))
    if p.clock:
        topics = [r for r in topics if r.topic.name != CLOCK]
    _check_names(topics, where)
    if not topics:
        msg = f"{bag}: none of its topics can be played here; see the lines above"
        raise ConfigError(msg)
    part = stretch(
        bag,
        offset_ns=_nanoseconds(p.start_offset_s),
        duration_ns=_nanoseconds(p.duration_s),
        until_ns=p.until_ns,
    )
    given = replace(
        p, clock_hz=p.clock_hz if p.clock else 0.0, window=p.window if p.lossless else 0
    )
    return PlaybackSettings(tuple(topics), stretch(bag), part, given)


def _nanoseconds(seconds: float) -> int:
    return round(seconds * 1e9)


def _is_playable(topic: BagTopic, warn: Callable[[str], object]) -> bool:
    """Say why a topic would be misread by its subscribers."""
    try:
        message_class(topic.type)
        problem = topic.problem
    except (KeyError, ValueError):
        problem = f"message type {topic.type} is not installed"
    if problem:
        warn(f"topic '{topic.name}' is not played: {problem}")
    return not problem


def _names(
    p: BagPlayerParameters,
    recorded: list[str],
    warn: Callable[[str], object],
    tell: Callable[[str], object],
) -> dict[str, str]:
    """Return under which name each topic is published.

    Where the player's prefix is free of real valves it takes the place of that of a simulated or
    replayed valve, so that its twin finds the topics; unless two would have one name.
    """
    prefix, renamed = p.publish_prefix, read_remaps(p.remap)
    names = {n: resolve_topic(renamed.get(n, n), "", prefix) for n in recorded}
    heads = [f"/{h.strip('/')}" for h in p.replaced_prefixes if h.strip("/")]
    for head in heads if is_free(prefix) else ():
        below = [n for n in recorded if n.startswith(f"{head}/") and n not in renamed]
        taken = {name for n, name in names.items() if n not in below}
        shorter = {n: resolve_topic(n.removeprefix(head), "", prefix) for n in below}
        for name in [n for n in below if shorter[n] in taken]:
            warn(f"topic '{name}' is played as '{names[name]}': '{shorter[name]}' is another's")
            del shorter[name]
        names |= shorter
        if shorter:
            tell(f"{len(shorter)} topics recorded below {head} are played below {prefix} instead")
    return names


def _topics(
    p: BagPlayerParameters, topics: list[BagTopic], names: dict[str, str]
) -> list[PlayedTopic]:
    path = p.qos_overrides_path
    overrides = read_overrides(path) if path else {}
    clock_topics = p.clock_topics
    lossless = p.lossless
    found = []
    for topic in topics:
        offer = _lossless(topic.qos) if lossless else topic.qos
        offer = override(offer, overrides.get(topic.name, {}), f"{path}: topic '{topic.name}'")
        ticks = not clock_topics or topic.name in clock_topics
        found.append(PlayedTopic(topic, names[topic.name], offer, ticks))
    return found


def _lossless(offer: OfferedQos) -> OfferedQos:
    """Serve best-effort subscribers too, but lose nothing to reliable ones."""
    return replace(offer, reliability="reliable", history="keep_last")


def _check_names(topics: list[PlayedTopic], where: str) -> None:
    types: dict[str, str] = {}
    for played in topics:
        try:
            validate_full_topic_name(played.name)
        except InvalidTopicNameException as err:
            reason = str(err).splitlines()[0]
            msg = f"{where}: '{played.name}' is no topic name ({reason}); correct publish_prefix"
            raise ConfigError(msg) from err
        if types.setdefault(played.name, played.topic.type) != played.topic.type:
            msg = (
                f"{where}: '{played.name}' would carry {types[played.name]} and "
                f"{played.topic.type}; correct key 'remap'"
            )
            raise ConfigError(msg)


def publisher_profile(offer: OfferedQos, *, latched: bool) -> QoSProfile:
    """Return the profile of a publisher.

    Parameters
    ----------
    offer : OfferedQos
        Its policies.
    latched : bool
        Whether it may keep messages for subscribers that come later.
    """
    keeps = offer.is_latched and latched
    made = QoSProfile(
        history=HistoryPolicy.KEEP_ALL
        if offer.history == "keep_all" and not keeps
        else HistoryPolicy.KEEP_LAST,
        # a reader cannot tell how much a volatile writer keeps, only that it loses less
        depth=offer.depth if keeps else max(offer.depth, DEPTH),
        reliability=ReliabilityPolicy.BEST_EFFORT
        if offer.reliability == "best_effort"
        else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if keeps else DurabilityPolicy.VOLATILE,
    )
    for name in ("deadline", "lifespan", "liveliness_lease_duration"):
        value = getattr(offer, name)
        if value < FOREVER_NS:
            setattr(made, name, Duration(nanoseconds=value))
    if offer.liveliness == "manual_by_topic":
        made.liveliness = LivelinessPolicy.MANUAL_BY_TOPIC
    return made
