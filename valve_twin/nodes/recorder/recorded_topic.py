# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""One topic of the recorder: taken as it is offered, losses counted."""

from __future__ import annotations

import math
import time
from collections import OrderedDict
from typing import TYPE_CHECKING, Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from valve_twin.compat.ros import message_and_info, take_with_info
from valve_twin.io.bags.qos import FOREVER_NS
from valve_twin.io.bags.qos import QosProfile as OfferedQos
from valve_twin.io.cdr.message_types import message_class
from valve_twin.io.recording.ring_buffer import RecordedMessage
from valve_twin.nodes.runtime.safety import is_free
from valve_twin.nodes.runtime.second_reader import (
    MOST_KEPT,
    RESENT_S,
    SecondReader,
    refused_policy,
)
from valve_twin.nodes.runtime.transport.pass_over import pass_over_missing

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rclpy.duration import Duration
    from rclpy.node import Node

_DEPTH = 100_000

START_PATIENCE_S = 0.5
"""So much later than a second reader one that was just made may hear, before it is deaf [s]."""

FORGET_S = 30.0
"""So long after a second reader what it heard is known, for what the first hears late [s]."""

DEAF_BEHIND = "a publisher sent a message of 0 bytes, behind which nothing came"
DEAF_FROM_START = "heard nothing since it listens, while another subscription heard"

MEET_S = 1.0
"""How often a publisher that this subscription does not meet is asked for what it offers [s]."""

DEAF_TOLD_S = 30.0
"""A line about deafness is not repeated earlier [s]."""

_POLICIES: dict[str, Any] = {
    "reliability": ReliabilityPolicy,
    "durability": DurabilityPolicy,
    "history": HistoryPolicy,
}
_NUMBERS = {
    "reliability": {1: "reliable", 2: "best_effort"},
    "durability": {1: "transient_local", 2: "volatile"},
    "history": {1: "keep_last", 2: "keep_all"},
}


class RecordedTopic:
    """Subscription of one topic.

    Parameters
    ----------
    node : Node
        The recorder.
    name, kind : str
        Topic and message type.
    on_message : callable
        Gets every message and this topic.
    policies : mapping, optional
        QoS policies that a user wants; the others adapt to what is offered.

    Raises
    ------
    KeyError
        If the message type is not installed.
    """

    def __init__(
        self,
        node: Node,
        name: str,
        kind: str,
        on_message: Callable[[RecordedMessage, RecordedTopic], None],
        policies: Mapping[str, Any] | None = None,
    ) -> None:
        self._node, self.name, self.kind = node, name, kind
        self._class = message_class(kind)
        self._on_message = on_message
        self._policies = dict(policies or {})
        self._first = self._last = self._last_sent_ns = 0
        self._last_info: Any = {}
        self.lost_transport = self.lost_recorder = 0
        self.publishers = 0
        self._refused = self._told = False
        self._met_s = -math.inf
        self._simulated = bool(node.get_parameter("use_sim_time").value)
        fields = self._class.get_fields_and_field_types()
        self.stamped = next(iter(fields.values()), "") == "std_msgs/Header"
        profiles = self._look()
        self._profile = _matching(profiles, self._policies)
        self._subscription: Any = None
        self._recent: OrderedDict[tuple[int, int], None] = OrderedDict()
        self._beside_s = 0.0
        self.listen()

    @property
    def latched(self) -> bool:
        """Whether publishers keep their last messages for those who come later."""
        return any(o.durability == "transient_local" for o in self.offered)

    @property
    def heard(self) -> bool:
        """Whether a message has come since it listens."""
        return self._last > 0

    def adapt(self) -> bool:
        """Subscribe anew where what is offered now asks for it; return whether the offer changed.

        A quality that one publisher does not offer is asked of none. Subscribe anew also where
        this subscription is deaf, see `SecondReader`.
        """
        if cause := self._deaf_by():
            self._node.destroy_subscription(self._subscription)
            self._subscription, self._last_info = self._subscribe(), {}
            self._tell(f"{cause}: subscribed anew")
        count = self._node.count_publishers(self.name)
        changed = count != self.publishers
        if not (changed or self._has_unmet(count)):
            return False
        before = self.offered
        profiles = self._look()
        refused = [p for p in profiles if refused_policy(p, self._profile)]
        self._refused = bool(refused)
        self._told &= self._refused and not changed
        wanted = _matching(profiles, self._policies) if profiles else self._profile
        weaker = (
            wanted.reliability != self._profile.reliability
            and wanted.reliability == ReliabilityPolicy.BEST_EFFORT
        ) or (
            wanted.durability != self._profile.durability
            and wanted.durability == DurabilityPolicy.VOLATILE
        )
        if weaker:
            self.silence()
            self._profile = wanted
            self._subscription = self._subscribe()
            self._node.get_logger().info(
                f"{self.name}: subscribed anew as {wanted.reliability.name.lower()}, "
                f"{wanted.durability.name.lower()}, which all its publishers offer"
            )
            self._refused = False
        elif self._refused and not self._told:
            self._told = True
            self._node.get_logger().warning(
                f"{self.name}: a publisher offers less than is asked for "
                f"({refused_policy(refused[0], self._profile)}) and is not recorded; "
                "correct the file of qos_profile_overrides_path"
            )
        return self.offered != before

    def listen(self) -> None:
        """Subscribe, where this is not done; what was sent meanwhile was not wanted."""
        if self._subscription is None:
            self._first = self._last = self._last_sent_ns = 0
            self._last_info = {}
            self._recent.clear()
            self._second = self._watch()
            self._subscription = self._subscribe()

    def silence(self) -> None:
        """Take what has arrived, also beside a subscription that may be deaf; stop listening."""
        subscription, self._subscription = self._subscription, None
        if subscription is None:
            return
        while (
            arrived := subscription.handle.take_message(subscription.msg_type, True)
        ) is not None:
            self._take(arrived)
        self._second.hand_over()
        self._second.close()
        self._node.destroy_subscription(subscription)

    def _look(self) -> list[QoSProfile]:
        """Note the publishers and what they offer."""
        found = self._node.get_publishers_info_by_topic(self.name)
        self.publishers = len(found)
        profiles = [p.qos_profile for p in found if p.topic_type == self.kind]
        if profiles:
            self.offered = tuple(dict.fromkeys(_offered(p) for p in profiles))
        elif not hasattr(self, "offered"):
            self.offered = (OfferedQos(),)
        return profiles

    def _has_unmet(self, count: int) -> bool:
        """Return, now and then, whether this subscription misses one of so many publishers.

        An event of the reader would tell, too; but one that is queued while its reader is
        destroyed ends the process under the events executor (ros2/rclpy#1644).
        """
        now_s = time.monotonic()
        if self._subscription is None or now_s < self._met_s + MEET_S:
            return False
        self._met_s = now_s
        return bool(count > self._subscription.get_publisher_count())

    def _subscribe(self) -> Any:
        subscription = self._node.create_subscription(
            self._class,
            self.name,
            self._take,
            self._profile,
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )
        return take_with_info(subscription)

    def _watch(self) -> SecondReader:
        """Return a watch that doubts from the first look on: what it keeps is not lost then."""
        destroy = self._node.destroy_subscription
        return SecondReader(
            self._listen_beside,
            destroy,
            lambda *_: None,  # it is recorded when it comes
            start_s=0.0,
            pass_over=self._pass_over,
            most_kept=1,
        )

    def _pass_over(self, newest: tuple[Any, ...]) -> bool:
        """Give up what is missing, so that what has arrived behind it is recorded, too."""
        _, info = message_and_info(newest)
        done = pass_over_missing(self._node, self.name, self.kind, self._last_info, info)
        if done:
            self._tell(f"{DEAF_BEHIND}: passed over")
        return done

    def _tell(self, text: str) -> None:
        self._node.get_logger().warning(f"{self.name}: {text}", throttle_duration_sec=DEAF_TOLD_S)

    def _deaf_by(self) -> str:
        """Say why this subscription is deaf; empty where it is not."""
        reliable = self._profile.reliability == ReliabilityPolicy.RELIABLE
        if self._subscription is None or not reliable:
            return ""
        now_s, unheard = time.monotonic(), self._second.never_heard
        met = not self._refused or self._subscription.get_publisher_count()
        if self.publishers and met and not is_free(self.name):
            self._second.expect(now_s)  # a simulated valve or a player may wait: it counts readers
        if self._second.is_open:
            self._beside_s = now_s
        elif now_s - self._beside_s > FORGET_S:
            self._recent.clear()
        if not self._second.look(now_s, START_PATIENCE_S if unheard else RESENT_S):
            return ""
        return DEAF_FROM_START if unheard else DEAF_BEHIND

    def _listen_beside(self, callback: Callable[..., None]) -> Any:
        """Make the second reader; both record, what one had the other leaves."""

        def take(*arguments: Any) -> None:
            callback(*arguments)
            self._stand_in(*arguments)

        profile = QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        return take_with_info(
            self._node.create_subscription(
                self._class,
                self.name,
                take,
                profile,
                event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
                raw=True,
            )
        )

    def _stand_in(self, *arguments: Any) -> None:
        """Take a message of the second reader that the first had not."""
        data, info = message_and_info(arguments)
        behind = self._last - int(info["publication_sequence_number"])
        heard = self.publishers == 1 and not self._recent and 0 <= behind < MOST_KEPT
        if not heard and self._is_new(info):
            self._keep(data, info)

    def _is_new(self, info: Any) -> bool:
        """Note a message while two readers listen; return whether the other one had it not."""
        key = int(info["publication_sequence_number"]), int(info["source_timestamp"])
        if key in self._recent:
            return False
        self._recent[key] = None
        if len(self._recent) > _DEPTH:  # so many a reader that hears late may have waiting
            self._recent.popitem(last=False)
        return True

    def _take(self, *arguments: Any) -> None:
        data, info = message_and_info(arguments)
        self._second.heard, self._last_info = True, info
        if not (self._recent or self._second.is_open) or self._is_new(info):
            self._keep(data, info)

    def _keep(self, data: bytes, info: Any) -> None:
        sequence = int(info["publication_sequence_number"])
        sent_ns = int(info["source_timestamp"])
        if self._recent and sent_ns < self._last_sent_ns:  # late: it was taken for lost
            counted = self.publishers <= 1 and self._first < sequence < self._last
            self.lost_transport -= counted and self.lost_transport > 0
        else:
            if not 0 < self._first <= self._last < sequence:
                self._first = sequence
            if self.publishers <= 1 and 0 < self._last < sequence:
                self.lost_transport += sequence - self._last - 1
            self._last, self._last_sent_ns = sequence, sent_ns
        log_ns = int(info["received_timestamp"])
        if self._simulated:
            log_ns = self._node.get_clock().now().nanoseconds
            if log_ns == 0:
                return  # simulated time has not begun
        message = RecordedMessage(self.name, data, log_ns, sent_ns)
        self._on_message(message, self)


def _matching(offered: list[QoSProfile], policies: Mapping[str, Any]) -> QoSProfile:
    """Ask for the best that all publishers offer, or for what a user wants."""
    profile = QoSProfile(depth=_DEPTH)
    reliable = all(p.reliability == ReliabilityPolicy.RELIABLE for p in offered)
    latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in offered)
    profile.reliability = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
    profile.durability = (
        DurabilityPolicy.TRANSIENT_LOCAL if latched and offered else DurabilityPolicy.VOLATILE
    )
    for name, kind in _POLICIES.items():
        value = _NUMBERS[name].get(policies.get(name), policies.get(name))  # type: ignore[arg-type]
        if value is not None:
            setattr(profile, name, kind[str(value).upper()])
    if "depth" in policies:
        profile.depth = int(policies["depth"])
    return profile


def _offered(profile: QoSProfile) -> OfferedQos:
    history = profile.history.name.lower()
    return OfferedQos(
        reliability=profile.reliability.name.lower(),
        durability=profile.durability.name.lower(),
        history="keep_all" if history == "keep_all" else "keep_last",
        depth=max(int(profile.depth), 1),
        liveliness="manual_by_topic" if "MANUAL" in profile.liveliness.name else "automatic",
        deadline=_nanoseconds(profile.deadline),
        lifespan=_nanoseconds(profile.lifespan),
        liveliness_lease_duration=_nanoseconds(profile.liveliness_lease_duration),
    )


def _nanoseconds(duration: Duration) -> int:
    """Return a duration, where 0 is unset and stands for ever [ns]."""
    return min(int(duration.nanoseconds), FOREVER_NS) or FOREVER_NS
