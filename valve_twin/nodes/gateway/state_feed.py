# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Verdicts, trends, last cycles and faults of nodes off their latched topics, for what is shown.

They come once a cycle or less, so they are taken from a reader that no executor drives, see
`live_feed`.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from valve_twin_msgs import msg

from valve_twin.compat.ros import take_waiting
from valve_twin.core.aging.verdict import Trend, Verdict
from valve_twin.gateway.view import LastCycle, NodeFault
from valve_twin.nodes.gateway.live_feed import nothing
from valve_twin.nodes.runtime import messages as convert
from valve_twin.nodes.runtime.stamps import from_time

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rclpy.node import Node

    from valve_twin.gateway.live.told import Told

DISCOVER_EVERY = 5
"""What is published, and by whom, is asked at one look in so many [1]."""

MOST_NEW = 5
"""Topics that are found and subscribed to at one look [1]: rclpy keeps all threads waiting while
it makes a subscription, which takes 10 ms where many nodes come at a time."""

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

_FAULTS = "valve_twin_msgs/msg/Faults"


class _Topic:
    """One topic that is read.

    Parameters
    ----------
    subscription : Subscription
        A raw one.
    take : callable
        Takes the newest message; None where nobody publishes any more.
    """

    def __init__(self, subscription: Any, take: Callable[[Any], None]) -> None:
        self.subscription, self._take = subscription, take
        self._data: bytes | None = None

    @property
    def is_heard(self) -> bool:
        """Whether something was taken of who publishes now."""
        return self._data is not None

    def look(self) -> bool:
        """Take what came since the last look; return whether it says something new."""
        found = take_waiting(self.subscription, LATCHED.depth)
        if not found or found[-1] == self._data:
            return False
        self._data = found[-1]
        self._take(deserialize_message(self._data, self.subscription.msg_type))
        return True

    def forget(self) -> None:
        """Take it that nobody publishes any more."""
        self._data = None
        self._take(None)


class StateFeed:
    """Reads the state topics of all valves and the faults of all nodes; on the node's thread only.

    Parameters
    ----------
    reader : Node
        Holds the subscriptions; driven by nobody.
    valves : iterable of str
        Names of the valves.
    told : Told
        Takes what comes.
    """

    def __init__(self, reader: Node, valves: Iterable[str], told: Told) -> None:
        self._reader, self._told, self._looks = reader, told, 0
        self._is_news = False
        self._valves = tuple(valves)
        self._verdicts: dict[str, Verdict | None] = {}
        self._trends: dict[str, dict[str, Trend]] = {valve: {} for valve in self._valves}
        self._topics: dict[str, _Topic] = {}
        self._wanted: dict[str, tuple[Any, Callable[[Any], None]]] = {}
        for valve in self._valves:
            own, word = f"{valve}/twin/cycle", f"{valve}/aging_monitor/verdict"
            self._subscribe(own, msg.CycleSummary, partial(self._on_cycle, valve))
            self._subscribe(word, msg.Verdict, partial(self._on_word, valve))

    def look(self) -> None:
        """Take what came since the last look."""
        if self._looks % DISCOVER_EVERY == 0:
            self._discover()
        self._looks += 1
        for _ in range(min(MOST_NEW, len(self._wanted))):
            topic = next(iter(self._wanted))
            self._subscribe(topic, *self._wanted.pop(topic))
        for of in self._topics.values():
            self._is_news |= of.look()
        self._judge()

    def end(self) -> None:
        """Take all down."""
        for topic in self._topics.values():
            self._reader.destroy_subscription(topic.subscription)
            topic.forget()
        self._is_news = True
        self._judge()
        self._topics, self._wanted = {}, {}

    def _subscribe(self, topic: str, kind: Any, take: Callable[[Any], None]) -> None:
        made = self._reader.create_subscription(kind, topic, nothing, LATCHED, raw=True)
        self._topics[topic] = _Topic(made, take)

    def _discover(self) -> None:
        """Want what is published now, and forget what nobody publishes any more."""
        for topic, of in self._topics.items():
            if of.is_heard and not self._reader.count_publishers(topic):
                of.forget()
                self._is_news = True
        for topic, types in self._reader.get_topic_names_and_types():
            if topic in self._topics or topic in self._wanted:
                continue
            if _FAULTS in types:
                self._wanted[topic] = msg.Faults, partial(self._on_faults, topic)
                continue
            valve, _, parameter = topic.partition("/aging_monitor/trend/")
            if parameter and valve in self._trends:
                self._wanted[topic] = msg.Trend, partial(self._on_trend, valve, parameter)

    def _judge(self) -> None:
        if not self._is_news:
            return
        self._is_news = False
        for valve, verdict in self._verdicts.items():
            self._told.judge(valve, verdict, tuple(self._trends[valve].values()))

    def _on_cycle(self, valve: str, message: Any) -> None:
        last = None
        if message is not None:
            end_ns = from_time(message.end)
            last = LastCycle(message.cycle, end_ns, message.accepted, message.reason)
        self._told.close_cycle(valve, last)

    def _on_word(self, valve: str, message: Any) -> None:
        self._verdicts[valve] = convert.to_value(Verdict, message) if message is not None else None

    def _on_trend(self, valve: str, parameter: str, message: Any) -> None:
        if message is None:
            self._trends[valve].pop(parameter, None)
        else:
            self._trends[valve][parameter] = convert.to_value(Trend, message)

    def _on_faults(self, topic: str, message: Any) -> None:
        faults = message.faults if message is not None else ()
        self._told.report(
            topic,
            [
                NodeFault(
                    node=message.node,
                    valve=fault.valve,
                    code=fault.code,
                    subject=fault.subject,
                    evidence=fault.evidence,
                    remedy=fault.remedy,
                    first_ns=from_time(fault.first),
                )
                for fault in faults
                if fault.status == msg.Fault.CONFIRMED
            ],
        )
