# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Subscriptions to the signals of a valve: losses counted, reasons for silence named."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import (
    HistoryPolicy,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.serialization import deserialize_message

from valve_twin.compat.ros import message_and_info, overrides_of, take_with_info, without_place
from valve_twin.io.cdr.message_types import RosTypes, message_class
from valve_twin.io.cdr.signals import Extractor, SignalBlock, SignalSource
from valve_twin.io.errors import ConfigError
from valve_twin.nodes.runtime.node import RCLError
from valve_twin.nodes.runtime.safety import is_replayed, node_name
from valve_twin.nodes.runtime.second_reader import Pace, SecondReader, refused_policy
from valve_twin.nodes.runtime.transport.pass_over import pass_over_missing
from valve_twin.nodes.twin.topic_graph import TopicGraph

if TYPE_CHECKING:
    from rclpy.node import Node

INPUT_CODES = ("input.missing", "input.type", "input.qos", "input.silent")
"""Faults that `TopicInput.problem` tells of: at most one at a time."""

OVERRUN_S = 0.5
"""A message that waited this long to be taken, and before which some are missing, tells of an
overrun of our own queue, not of a loss on the way [s]."""

BESIDE = 1000
"""Depth of a second reader where the first keeps all [1]."""

MOST_BYTES = 8_000_000
"""A longer message is refused: a million samples [B]."""

DEAF_BEHIND = "its publisher sent a message of 0 bytes, behind which nothing came"
DEAF_FROM_START = "from the start on its reliable subscription got nothing, which another one got"

MEET_S = 1.0
"""How often a topic that has a publisher, heard or refused, is looked at for more of them [s]."""

FORGOTTEN_S = 60.0
"""A topic whose subscription is deaf twice within this time is taken best effort [s]."""

OnBlock = Callable[[SignalBlock, int], None]

_Arrival: TypeAlias = tuple[Any, Any, int]
"""A message, what the middleware says about it, and the receive time [ns]."""


@dataclass(frozen=True, slots=True)
class InputConfig:
    """How inputs are subscribed.

    Attributes
    ----------
    depth : int
        Queue depth [messages]: deep, so that the topics of a valve stay in step. 0 = all: the
        middleware refuses what it cannot hold and the publisher offers it again, seconds later.
    deadline_s : float
        Longest time between two messages that a publisher has to promise [s], 0 = none asked for.
    silence_s : float
        After this long without a message a topic is called silent [s].
    """

    depth: int = 100_000
    deadline_s: float = 0.0
    silence_s: float = 5.0


def seconds_now() -> float:
    """Return the steady clock [s]."""
    return time.monotonic()


class TopicInput:
    """One topic that carries one or more signals.

    Parameters
    ----------
    node : Node
        Where to subscribe.
    extractors : sequence of Extractor
        Ways to the signals, all of one topic and type.
    config : InputConfig
        Queue, deadline and silence.
    on_arrival : callable
        Called for every message with its receive time [ns]; the message is kept until `drain`.
    on_block : callable
        Gets every block of samples and when the middleware received it [ns].
    now_ns : callable
        Receive time on the node's clock, for messages without a stamp; 0 = not known yet [ns].
    """

    def __init__(
        self,
        node: Node,
        extractors: Sequence[Extractor],
        config: InputConfig,
        on_arrival: Callable[[int], None],
        on_block: OnBlock,
        now_ns: Callable[[], int],
    ) -> None:
        self._node = node
        self._config = config
        self._on_arrival = on_arrival
        self._on_block = on_block
        self._pending: list[_Arrival] = []
        self._now_ns = now_ns
        self.topic = extractors[0].source.topic
        self.type = extractors[0].source.type
        self.signals = tuple(e.source.signal for e in extractors)
        self._extractors = extractors
        self._raw = all(e.is_raw_readable for e in self._extractors)
        self._class = message_class(self.type)
        self._last_sequence = self._stood_in = 0
        self._last_info: Any = {}
        self._matched = self._met = 0
        self._met_s = -math.inf
        self._since = seconds_now()
        self._heard: float | None = None
        self._graph = TopicGraph(node, self.topic, self.type)
        self._reliable = not self._graph.is_best_effort()
        self.received = self.lost = self.overrun = self.broken = self.deadlines_missed = 0
        self.deaf, self.deaf_why = 0, ""
        self._deaf_s = -math.inf
        self.refused_policy = ""
        self._lossless = is_replayed(self.topic) or bool(node.get_parameter("use_sim_time").value)
        self._pace = Pace()
        skip, gone = self._pass_over, node.destroy_subscription
        self._second = SecondReader(self._listen_beside, gone, self._stand_in, pass_over=skip)
        self._subscription = self._subscribe()

    def destroy(self) -> None:
        """Stop listening."""
        self._second.close()
        self._node.destroy_subscription(self._subscription)

    def look(self, now_s: float) -> None:
        """Meet the publishers; help where this subscription is deaf, or listen anew.

        Every `LOOK_S`, so what a topic costs that needs nothing is a few microseconds.

        Anew the second time as best effort: such a reader is not made deaf by what makes a
        reliable one deaf. A replay sends no message of 0 bytes, but may pause, and waits for all
        that it has sent.

        Parameters
        ----------
        now_s : float
            The steady clock [s].
        """
        self._meet(now_s)
        if self._lossless:
            return
        beside = self._second
        self._pace.look(now_s)
        if not beside.is_due(now_s):
            return
        unheard = beside.never_heard
        expected = unheard and not self.refused_policy
        there = self._matched or (expected and self._node.count_publishers(self.topic))
        if not ((there and self._reliable) or beside.stands_in):
            return
        beside.expect(now_s)
        if beside.newest:
            self._note_pace(beside.newest, now_s)
        alone = beside.heard or unheard or beside.is_alone
        if not beside.look(now_s, self._pace.patience_s(now_s, alone=alone)):
            return
        if not beside.passed:
            self.deaf, self.deaf_why = self.deaf + 1, DEAF_FROM_START if unheard else DEAF_BEHIND
        self._reliable = now_s - self._deaf_s > FORGOTTEN_S
        self._deaf_s = now_s
        self._listen_anew()

    def _pass_over(self, newest: tuple[Any, ...]) -> bool:
        """Give up what is missing, so that what has arrived behind it is heard."""
        _, info = message_and_info(newest)
        heard = self._last_info if self._matched == 1 else {}
        if not pass_over_missing(self._node, self.topic, self.type, heard, info):
            return False
        self.deaf, self.deaf_why = self.deaf + 1, DEAF_BEHIND
        return True

    def _listen_anew(self) -> None:
        self._last_info = {}
        self._node.destroy_subscription(self._subscription)
        self._matched = self._met = 0
        self._subscription = self._subscribe()

    def _meet(self, now_s: float) -> None:
        """Note the publishers; take best effort, or say what is refused, where one offers less.

        Events of the reader would tell, too; but one that is queued while its reader is destroyed
        ends the process under the events executor (ros2/rclpy#1644).
        """
        self._note_matched()
        if (self._matched or self.refused_policy) and now_s < self._met_s + MEET_S:
            return
        self._met_s = now_s
        self.refused_policy = ""
        if self._node.count_publishers(self.topic) <= self._matched:
            return
        asked = self._subscription.qos_profile
        offers = self._node.get_publishers_info_by_topic(self.topic)
        for offer in (o for o in offers if o.topic_type == self.type):
            self.refused_policy = refused_policy(offer.qos_profile, asked) or self.refused_policy
        if self.refused_policy == "RELIABILITY" and self._reliable:
            self._reliable, self.refused_policy = False, ""
            self._second.close()
            self.drain()
            self._node.get_logger().info(
                f"topic '{self.topic}' is offered best effort: taken so, losses are counted"
            )
            self._last_sequence = 0
            self._listen_anew()

    def _note_matched(self) -> None:
        """Begin the numbering anew where a publisher came or went: each counts for itself."""
        matched = self._count_matched()
        if matched == self._matched:
            return
        self._met += max(matched - self._matched, 0)
        self._matched, self._last_info = matched, {}
        if self._met > 1:
            self._last_sequence = self._stood_in = 0

    def _note_pace(self, arguments: tuple[Any, ...], now_s: float) -> None:
        """Note how far a message that the second reader keeps runs ahead."""
        data, _ = message_and_info(arguments)
        arrival, broken = (data, None, self._now_ns()), self.broken
        for found in [arrival] if self._raw else self._decoded([arrival]):
            for block in self._read(self._extractors[0], [found]):
                self._pace.note(int(block.stamp_ns[-1]), now_s)
        self.broken = broken  # counted when it is delivered

    def problem(self) -> tuple[str, str]:
        """Return fault code and one line why this topic gives nothing, both empty if it does."""
        if self._matched and self._heard is not None and self.age_s <= self._config.silence_s:
            return "", ""  # the graph need not be asked
        publishers = self._graph.publishers(seconds_now())
        names = ", ".join(self.signals)
        key = f"signals.{self.signals[0]}"
        wrong = [p for p in publishers if p.topic_type != self.type]
        if wrong and len(wrong) == len(publishers):
            return "input.type", (
                f"topic '{self.topic}' (signal {names}) carries {wrong[0].topic_type}, not "
                f"{self.type}: "
                f"set {key}.type to {wrong[0].topic_type} and {key}.field to its field"
            )
        if not publishers and self._heard is None:
            self._since = seconds_now()  # one that comes now has not been silent
            return "input.missing", (
                f"topic '{self.topic}' (signal {names}) has no publisher: start it or correct "
                f"{key}.topic; {self._graph.suggestion(seconds_now())}"
            )
        if self.refused_policy and publishers and not self._matched:
            return "input.qos", (
                f"topic '{self.topic}' (signal {names}): its publisher {node_name(publishers[0])} "
                f"offers an incompatible {self.refused_policy}: change that policy there, or set "
                f"{self._remedy()}"
            )
        if self.age_s > self._config.silence_s:
            look = (
                f"look at its publisher {node_name(publishers[0])}"
                if publishers
                else "it has no publisher any more: start it"
            )
            return "input.silent", (
                f"topic '{self.topic}' (signal {names}) is silent for {self.age_s:.0f} s: {look}"
            )
        return "", ""

    @property
    def age_s(self) -> float:
        """Time since the last message, before it since there is a publisher [s]."""
        return seconds_now() - (self._heard if self._heard is not None else self._since)

    def _remedy(self) -> str:
        if self.refused_policy == "DEADLINE":
            return "deadline_s here"
        return f"qos_overrides.{self.topic}.subscription.{self.refused_policy.lower()} here"

    def _subscribe(self) -> Any:
        config = self._config
        profile = QoSProfile(
            history=HistoryPolicy.KEEP_LAST if config.depth else HistoryPolicy.KEEP_ALL,
            depth=config.depth or 1,
            reliability=ReliabilityPolicy.RELIABLE
            if self._reliable
            else ReliabilityPolicy.BEST_EFFORT,
        )
        if config.deadline_s > 0.0:
            profile.deadline = Duration(nanoseconds=round(config.deadline_s * 1e9))
        try:
            subscription = self._create(profile)
        except RCLError as err:
            msg = (
                f"topic '{self.topic}' (signal {', '.join(self.signals)}) cannot be subscribed as "
                f"{self.type}: {without_place(err)}; correct signals.{self.signals[0]}.type"
            )
            raise ConfigError(msg) from err
        self._count_matched = subscription.handle.get_publisher_count  # a quarter of rclpy's time
        return take_with_info(subscription)

    def _create(self, profile: QoSProfile) -> Any:
        config = self._config
        return self._node.create_subscription(
            self._class,
            self.topic,
            self._on_message,
            profile,
            event_callbacks=SubscriptionEventCallbacks(
                deadline=self._on_deadline if config.deadline_s > 0.0 else None,
                use_default_callbacks=False,
            ),
            qos_overriding_options=self._overridable(),
            raw=True,
        )

    def _listen_beside(self, callback: Callable[..., None]) -> Any:
        profile = QoSProfile(
            depth=self._config.depth or BESIDE, reliability=ReliabilityPolicy.BEST_EFFORT
        )
        quiet = SubscriptionEventCallbacks(use_default_callbacks=False)
        create = self._node.create_subscription
        return take_with_info(
            create(self._class, self.topic, callback, profile, event_callbacks=quiet, raw=True)
        )

    def _overridable(self) -> QoSOverridingOptions:
        """Offer policies as parameters; reliability follows the publisher unless it is given."""
        kinds = [QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.DURABILITY]
        key = f"qos_overrides.{self.topic}.subscription.reliability"
        if key in overrides_of(self._node):
            kinds.append(QoSPolicyKind.RELIABILITY)
        return QoSOverridingOptions(policy_kinds=kinds)

    def _on_message(self, *arguments: Any) -> None:
        """Keep a message: what comes together is read together."""
        message, info = message_and_info(arguments)
        self._second.heard, self._last_info = True, info
        if self._stood_in:
            if info["publication_sequence_number"] <= self._stood_in and self._matched == 1:
                return
            self._stood_in = 0
        self._pending.append((message, info, self._now_ns()))
        self._on_arrival(info["received_timestamp"])

    def _stand_in(self, *arguments: Any) -> None:
        """Keep a message that a second reader took in place of this deaf one."""
        message, info = message_and_info(arguments)
        self._stood_in = int(info["publication_sequence_number"])
        self._pending.append((message, info, self._now_ns()))
        self._on_arrival(info["received_timestamp"])

    def drain(self) -> None:
        """Read the messages that were kept and hand them on."""
        if not self._pending:
            return
        arrivals, self._pending = self._pending, []
        self._count(arrivals)
        oldest_ns = int(arrivals[0][1]["received_timestamp"])
        known = len(arrivals)
        arrivals = [a for a in arrivals if len(a[0]) <= MOST_BYTES]
        self.broken += known - len(arrivals)
        arrivals = [a for a in arrivals if a[2] != 0]  # before that simulated time has not begun
        if not self._raw:
            arrivals = list(self._decoded(arrivals))
        now_s = seconds_now()
        for extractor in self._extractors if arrivals else ():
            for block in self._read(extractor, arrivals):
                self._pace.note(int(block.stamp_ns[-1]), now_s)
                self._on_block(block, oldest_ns)

    def _decoded(self, arrivals: list[_Arrival]) -> Iterator[_Arrival]:
        for data, info, now_ns in arrivals:
            try:
                yield deserialize_message(data, self._class), info, now_ns
            except RuntimeError:
                self.broken += 1

    def _read(self, extractor: Extractor, arrivals: list[_Arrival]) -> Iterator[SignalBlock]:
        if self._raw and len(arrivals) > 1:
            run = extractor.from_run([a[0] for a in arrivals], [a[2] for a in arrivals])
            if run is not None:
                yield run
                return
        read = extractor.from_raw if self._raw else extractor
        for message, _, now_ns in arrivals:
            try:
                block = read(message, now_ns)
            except (ValueError, TypeError, AttributeError):
                self.broken += 1
                continue
            if len(block.values):
                yield block

    def _count(self, arrivals: list[_Arrival]) -> None:
        """Count the gaps in the publisher's numbering; only of one publisher are they losses."""
        self._note_matched()
        self._heard = seconds_now()
        self.received += len(arrivals)
        last = self._last_sequence
        self._last_sequence = int(arrivals[-1][1]["publication_sequence_number"])
        if self._matched > 1 or self._last_sequence - last == len(arrivals):
            return
        for _, info, _ in arrivals:
            sequence = int(info["publication_sequence_number"])
            if 0 < last < sequence - 1:
                self.lost += sequence - last - 1
                if time.time_ns() - int(info["received_timestamp"]) > OVERRUN_S * 1e9:
                    self.overrun += sequence - last - 1
            last = sequence

    def _on_deadline(self, event: Any) -> None:
        self.deadlines_missed = int(event.total_count)


def by_topic(node: Node, sources: Iterable[SignalSource]) -> list[list[Extractor]]:
    """Check the sources against their types and group those that share topic and type.

    Raises
    ------
    ConfigError
        If a type or a field does not exist; names the nearest.
    """
    groups: dict[tuple[str, str], list[Extractor]] = {}
    where = node.get_fully_qualified_name()
    for source in sources:
        extractor = Extractor(source, RosTypes(), where)
        groups.setdefault((source.topic, source.type), []).append(extractor)
    return list(groups.values())
