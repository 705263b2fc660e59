# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The bag player node: publishes a bag again, under a prefix, with /clock, in one order.

One queue holds the messages of all topics, so that their order is that of the bag at any rate.
"""

from __future__ import annotations

import json
from enum import Enum
from typing import TYPE_CHECKING, Any

from rclpy.qos import DurabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rosgraph_msgs.msg import Clock as ClockMessage

from valve_twin.io.errors import BagError, ValveTwinError
from valve_twin.io.mapping import message_class
from valve_twin.io.playback import bag_topics
from valve_twin.io.playback_reel import Reel
from valve_twin.nodes.convert import to_time
from valve_twin.nodes.flow import Flow, are_acked
from valve_twin.nodes.inputs import seconds_now
from valve_twin.nodes.log_bridge import LogBridge
from valve_twin.nodes.outlets import Gate, Outbox
from valve_twin.nodes.playback_clock import PlaybackClock
from valve_twin.nodes.player_plan import CLOCK, Plan, Route, profile, read_plan
from valve_twin.nodes.player_services import PlayerServices
from valve_twin.nodes.runtime import STEADY, ValveNode, run
from valve_twin.nodes.safety import CHECK_S, Guard, Outlet
from valve_twin.nodes.transport import is_quick, quicken, tidy

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from valve_twin.io.playback_choice import Stretch

TICK_S = 0.002
"""Period of the pacing timer [s]."""

MOST_MESSAGES = 128
"""Messages published in one tick: a callback has to end soon."""

MOST_SLOWLY = 32
"""The same where shared memory must not overflow, because what it drops is sent again seconds
later."""

JUMP_S = 1.0
"""How long what was sent before a jump may take to arrive before the jump is published [s]."""


class Phase(Enum):
    """What a player is about."""

    CLOSED = "not active"
    WAITING = "waits for the graph, its subscribers or the delay"
    JUMPING = "lets what was sent arrive before bag time jumps"
    PLAYING = "publishes what is due"
    ENDED = "has played the bag"
    STOPPED = "was stopped"


class BagPlayerNode(ValveNode):
    """Lifecycle node that plays one bag."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("bag_player", **kwargs)
        tidy()
        self._plan: Plan | None = None
        self._reel: Reel | None = None
        self._bridge: LogBridge | None = None
        self._outlets: list[Outlet] = []
        self._routes: dict[str, tuple[Route, Any]] = {}
        self._real: list[Any] = []
        self._timers_made: list[Any] = []
        self._outbox = Outbox()
        self._clock_publisher: Any = None
        self._time = PlaybackClock(1.0)
        self._flow: Flow | None = None
        self._gate = Gate()
        self._phase = Phase.CLOSED
        self._paused = False
        self._earliest_s = self._latest_s = self._jumped_s = self._ended_s = 0.0
        self._bursts: list[tuple[int, Callable[[int], None], int]] = []
        self._most = MOST_MESSAGES if is_quick() else MOST_SLOWLY
        self._played = self._round_began = 0
        PlayerServices(self)

    def start(self) -> None:
        """Start; a player that cannot play ends where it would end after playing."""
        super().start()
        if self.parameters["exit_at_end"] and self.state != "active":
            self.exit_code = 1

    def configure(self) -> None:
        """Open the bag."""
        self.parameters.warn_unknown(hosts_valves=False)
        self.parameters.check()
        self._bridge = LogBridge(self.get_logger())
        plan = read_plan(
            self.parameters, self.get_fully_qualified_name(), self.get_logger().warning
        )
        self._plan = plan
        self._outlets = [Outlet(r.name, command=True) for r in plan.routes]
        self._guard = Guard(
            self,
            prefix=str(self.parameters["publish_prefix"]),
            allow_live=bool(self.parameters["allow_live"]),
        )
        self._time = PlaybackClock(float(self.parameters["rate"]))
        self._paused = bool(self.parameters["start_paused"])
        self._reel = Reel(plan.bag, [r.topic for r in plan.routes], plan.part)
        self._time.jump(plan.part.begin_ns, 0.0)

    def activate(self) -> None:
        """Check that no real valve is in reach, then play."""
        assert self._plan is not None
        self._guard.check(self._outlets)
        for route, outlet in zip(self._plan.routes, self._outlets, strict=True):
            self._open(route, outlet)
        publishers = [p for _, p in self._routes.values()]
        if self.parameters["clock"]:
            self._clock_publisher = self.create_publisher(ClockMessage, CLOCK, 1000)
        window = int(self.parameters["window"]) if self.parameters["lossless"] else 0
        self._flow = Flow(self, publishers, window, seconds_now)
        now = seconds_now()
        self._gate = Gate()
        self._earliest_s = now + self._guard.settle_s
        self._latest_s = now + float(self.parameters["start_delay_s"])
        self._wait()
        self._timers_made = [
            self.create_timer(TICK_S, self._tick, clock=STEADY),
            self.create_timer(CHECK_S, self._watch, clock=STEADY),
        ]
        hertz = float(self.parameters["clock_hz"])
        if hertz and self._clock_publisher is not None:
            self._timers_made.append(
                self.create_timer(1.0 / hertz, self._publish_time, clock=STEADY)
            )

    def deactivate(self) -> None:
        """Stop publishing; activating again goes on from here."""
        if self._outbox and self._phase is Phase.PLAYING and self._reel is not None:
            self._reel.put_back()
        self._phase = Phase.CLOSED
        self._time.hold(seconds_now())
        for timer in self._timers_made:
            self.destroy_timer(timer)
        if self._flow is not None:
            self._flow.destroy()
        for _, publisher in self._routes.values():
            self.destroy_publisher(publisher)
        if self._clock_publisher is not None:
            self.destroy_publisher(self._clock_publisher)
        self._timers_made, self._routes, self._real = [], {}, []
        self._clock_publisher = self._flow = None
        self._outbox.release()
        self._answer_bursts()

    def cleanup(self) -> None:
        """Close the bag."""
        if self._reel is not None:
            self._reel.close()
        if self._bridge is not None:
            self._bridge.close()
        self._reel = self._plan = self._bridge = None
        self._outlets = []

    def _open(self, route: Route, outlet: Outlet) -> None:
        """Make the publisher of a topic; a real command is kept for nobody who comes later."""
        real = self._guard.is_real(outlet)
        offered = profile(route.offer, latched=not real)
        publisher = self.create_publisher(
            message_class(route.topic.type),
            route.name,
            offered,
            qos_overriding_options=None if real else QoSOverridingOptions.with_default_policies(),
        )
        self._routes[route.topic.name] = (route, publisher)
        if real:
            self._real.append(publisher)
        latched = offered.durability == DurabilityPolicy.TRANSIENT_LOCAL
        if latched and self.parameters["lossless"]:
            self._outbox.keep(publisher, offered.depth)

    # -- playing

    def _tick(self) -> None:
        """Publish what is due; a bag that cannot be read on or a real valve in reach ends it."""
        try:
            self._advance()
        except ValveTwinError as err:
            self._give_up(err)

    def _advance(self) -> None:
        if not self._is_safe() or not self._outbox.send() or not self._is_flowing():
            return
        if self._phase is Phase.WAITING and self._is_released():
            self._jump()
        if self._phase is Phase.JUMPING and self._has_arrived():
            self._begin()
        if self._phase is Phase.ENDED:
            self._end()
        elif self._phase is Phase.PLAYING:
            (self._play_bursts if self._paused else self._play_due)()

    def _play_due(self) -> None:
        reel = self._reel
        for _ in range(self._most):
            if reel is None or reel.next is None:
                self._reach_end()
                return
            if not self._time.is_due(reel.next.log_ns, seconds_now()):
                return
            if not self._play_one():
                return

    def _play_bursts(self) -> None:
        """Play what was asked for while paused."""
        for _ in range(self._most):
            if not self._bursts:
                return
            wanted, done, played = self._bursts[0]
            finished = wanted and played >= wanted
            if finished or self._reel is None or self._reel.next is None:
                self._bursts.pop(0)
                done(played)
                continue
            self._bursts[0] = (wanted, done, played + 1)
            if not self._play_one():
                return

    def _play_one(self) -> bool:
        """Publish the next message; return whether another may follow now."""
        message = self._reel.take() if self._reel is not None else None
        if message is None or self._flow is None:
            return False
        if self._paused or self._time.rate == 0.0:
            self._time.jump(message.log_ns, seconds_now())
        route, publisher = self._routes[message.topic]
        if self._clock_publisher is not None and route.ticks and not self.parameters["clock_hz"]:
            self._put_clock(message.log_ns)
        self._outbox.put(publisher, message.data)
        self._played += 1
        self._flow.count()
        return self._is_safe() and self._outbox.send() and self._is_flowing()

    def _reach_end(self) -> None:
        if self._plan is None or self._reel is None:
            return
        self.get_logger().info(f"end of the bag: {self._played} messages played")
        if self.parameters["loop"] and self._played > self._round_began:
            self._round_began = self._played
            self._reel.go(self._plan.part)
            self._wait()
        else:
            self._phase = Phase.ENDED
            self._ended_s = seconds_now()
            self._time.hold(seconds_now())

    def _end(self) -> None:
        """End the process where that is wanted and all subscribers have what was played."""
        if not self.parameters["exit_at_end"]:
            return
        late = seconds_now() - self._ended_s > float(self.parameters["acked_wait_s"])
        if late or are_acked(p for _, p in self._routes.values()):
            self.exit_code = 0

    # -- beginning, jumping

    def _wait(self) -> None:
        """Let everything be ready before the part of the reel begins."""
        assert self._reel is not None
        self._phase = Phase.WAITING
        self._time.hold(seconds_now())
        self._earliest_s = max(self._earliest_s, seconds_now() + float(self.parameters["delay_s"]))

    def _is_released(self) -> bool:
        """Begin when the graph is settled and enough subscribers are there."""
        now, wanted = seconds_now(), int(self.parameters["wait_for_subscribers"])
        publishers = [p for _, p in self._routes.values()]
        found = self._gate.is_open(publishers, max(wanted, 1), now)
        given_up = not wanted and now > self._latest_s
        if now < self._earliest_s or not (found or given_up):
            return False
        self._guard.check(self._outlets)
        if self._flow is not None:
            self._flow.meet()
        return True

    def _jump(self) -> None:
        """Go to where the reel stands once everything sent before has arrived."""
        self._outbox.clear()
        self._phase, self._jumped_s = Phase.JUMPING, seconds_now()

    def _has_arrived(self) -> bool:
        late = seconds_now() - self._jumped_s > JUMP_S
        return late or are_acked(p for _, p in self._routes.values())

    def _begin(self) -> None:
        """Publish the time and the state at the place where playing goes on."""
        reel, now = self._reel, seconds_now()
        if reel is None:
            return
        if reel.next is not None:
            at_ns = max(self._begin_ns(reel), 0)
            self._time.jump(at_ns, now)
            state = reel.state_before(at_ns)
            if state or self._paused or at_ns < reel.next.log_ns:
                self._put_clock(at_ns)  # else it goes before the first message anyway
            for message in state:
                self._outbox.put(self._routes[message.topic][1], message.data)
        if not self._paused:
            self._time.run(now)
        self._phase = Phase.PLAYING

    def _begin_ns(self, reel: Reel) -> int:
        """Return the bag time to go on from: that of the part, or of where it was left."""
        assert reel.next is not None
        inside = reel.part.begin_ns <= self._time.now_ns(seconds_now()) <= reel.next.log_ns
        return self._time.now_ns(seconds_now()) if inside else reel.part.begin_ns

    def _put_clock(self, at_ns: int) -> None:
        if self._clock_publisher is not None:
            self._outbox.put(self._clock_publisher, ClockMessage(clock=to_time(at_ns)))

    def _publish_time(self) -> None:
        """Publish /clock by the hertz; never ahead of a message that is still to come."""
        if self._phase not in (Phase.PLAYING, Phase.ENDED) or self._outbox:
            return
        at_ns = self._time.now_ns(seconds_now())
        if self._reel is not None and self._reel.next is not None:
            at_ns = min(at_ns, self._reel.next.log_ns)
        self._put_clock(at_ns)
        self._outbox.send()

    # -- safety

    def _is_safe(self) -> bool:
        """Return whether it may publish; raise where somebody has begun to take a real command."""
        if self._real:
            self._guard.check_taken(self._real)
        return self._phase is not Phase.CLOSED

    def _watch(self) -> None:
        try:
            self._guard.check(self._outlets)
        except ValveTwinError as err:
            self._give_up(err)

    def _give_up(self, err: Exception) -> None:
        self.get_logger().error(f"stopped: {err}")
        self._outbox.clear()
        self.trigger_deactivate()
        if self.parameters["exit_at_end"]:
            self.exit_code = 1

    def _is_flowing(self) -> bool:
        """Return whether the subscribers follow."""
        return self._flow is None or self._flow.is_open(strict=self._time.rate == 0.0)

    # -- what the services ask for

    @property
    def is_paused(self) -> bool:
        """Whether it is paused."""
        return self._paused

    @property
    def rate(self) -> float:
        """Bag seconds a second [1], 0 = as fast as the subscribers follow."""
        return self._time.rate

    def pause(self) -> None:
        """Let bag time stand."""
        self._paused = True
        self._time.hold(seconds_now())

    def resume(self) -> None:
        """Go on from where it stands."""
        self._paused = False
        self._answer_bursts()
        if self._phase is Phase.PLAYING:
            self._time.run(seconds_now())

    def set_rate(self, rate: float) -> bool:
        """Go on at another rate [1]; return whether it is one."""
        if not 0.0 < rate < float("inf"):
            return False
        self._time.set_rate(rate, seconds_now())
        return True

    def burst(self, messages: int, done: Callable[[int], None]) -> None:
        """Play so many messages, 0 = all that is left, and tell how many it were."""
        if not self._paused or self._phase not in (
            Phase.WAITING,
            Phase.JUMPING,
            Phase.PLAYING,
        ):
            done(0)
            return
        self._bursts.append((messages, done, 0))

    def seek(self, at_ns: int) -> bool:
        """Go on from a log time [ns]; return whether it lies in the bag."""
        plan, reel = self._plan, self._reel
        if plan is None or reel is None or self._phase in (Phase.CLOSED, Phase.STOPPED):
            return False
        if not plan.whole.begin_ns <= at_ns <= reel.part.end_ns:
            return False
        self._go(type(reel.part)(at_ns, reel.part.end_ns))
        return True

    def play(self, offset_ns: int, duration_ns: int, until_ns: int) -> bool:
        """Play a part of the bag; return False where it is being played already."""
        if self._plan is None or self._phase not in (Phase.ENDED, Phase.STOPPED):
            return False
        try:
            part = self._plan.part_from(offset_ns, duration_ns, until_ns)
        except BagError as err:
            self.get_logger().warning(f"not played: {err}")
            return False
        self._played = 0
        self._paused = False
        self._go(part)
        return True

    def stop_playing(self) -> None:
        """Stop; `play` begins again."""
        if self._phase is Phase.CLOSED:
            return
        self._phase = Phase.STOPPED
        self._time.hold(seconds_now())
        self._outbox.clear()
        self._answer_bursts()
        if self.parameters["exit_at_end"]:
            self.exit_code = 0

    def _go(self, part: Stretch) -> None:
        assert self._reel is not None
        self._reel.go(part)
        self._time.jump(part.begin_ns, seconds_now())
        if self._phase is not Phase.WAITING:
            self._time.hold(seconds_now())
            self._jump()

    def _answer_bursts(self) -> None:
        """Tell those who asked for more than they get."""
        for _, done, played in self._bursts:
            done(played)
        self._bursts = []


def play(
    bag: str,
    *,
    rate: float = 1.0,
    prefix: str = "/replay",
    clock: bool = False,
    more: Mapping[str, object] | None = None,
) -> int:
    """Play a bag and end the process; what `valve-twin replay` does.

    Parameters
    ----------
    bag : str
        The bag.
    rate : float
        Playback seconds a second, 0 = as fast as the subscribers follow [1].
    prefix : str
        Put before every topic.
    clock : bool
        Publish /clock.
    more : mapping, optional
        Further parameters of the player by name.

    Returns
    -------
    int
        Exit code; the process ends before it is returned.

    Raises
    ------
    BagError
        If the bag cannot be read.
    """
    bag_topics(bag)
    quicken()
    values = {"bag": bag, "rate": float(rate), "publish_prefix": prefix, "clock": clock}
    given = [f"{name}:={json.dumps(v)}" for name, v in {**values, **(more or {})}.items()]
    arguments = [a for g in (*given, "exit_at_end:=true") for a in ("-p", g)]
    return run(BagPlayerNode, ["--ros-args", *arguments])
