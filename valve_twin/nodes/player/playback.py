# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The course of a replay: begin, play, pause, step, jump, loop, end."""

from __future__ import annotations

import math
from enum import Enum
from typing import TYPE_CHECKING

from valve_twin.io.errors import BagError
from valve_twin.io.playback.choice import Stretch
from valve_twin.io.playback.reel import Reel
from valve_twin.nodes.player.clock import PlaybackClock
from valve_twin.nodes.twin.inputs import seconds_now

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.nodes.player.publishers import PlayerPublishers
    from valve_twin.nodes.player.settings import PlaybackSettings

JUMP_S = 1.0
"""How long what was sent before a jump may take to arrive before the jump is published [s]."""

MEET_S = 5.0
"""How much longer a subscriber that is in sight but not matched yet, or any at all, is waited for
[s]; on a busy machine the one was seen to come seconds after the other, and some never match."""


class Phase(Enum):
    """What a player is about."""

    CLOSED = "not active"
    WAITING = "waits for the graph, its subscribers or the delay"
    JUMPING = "lets what was sent arrive before bag time jumps"
    PLAYING = "publishes what is due"
    ENDED = "has played the bag"
    STOPPED = "was stopped"


class Playback:
    """Plays the part of a bag that is wanted.

    Parameters
    ----------
    settings : PlaybackSettings
        What is played, and how.
    most : int
        Messages published at a time.
    say, warn : callable
        Get a line for the log, and one on what is left out.
    """

    def __init__(
        self,
        settings: PlaybackSettings,
        most: int,
        say: Callable[[str], object],
        warn: Callable[[str], object],
    ) -> None:
        self._settings = settings
        self._most = most
        self._say = say
        topics = [r.topic for r in settings.topics]
        self._reel = Reel(settings.given.bag, topics, settings.part, settings.whole, warn)
        self._time = PlaybackClock(settings.given.rate)
        self._time.jump(settings.part.begin_ns, 0.0)
        self._publishers: PlayerPublishers | None = None
        self._earliest_s = self._latest_s = self._jumped_s = 0.0
        self._bursts: list[tuple[int, Callable[[int], None], int]] = []
        self.played = self._round_began = 0
        self.phase = Phase.CLOSED
        self.is_paused = settings.given.start_paused

    @property
    def rate(self) -> float:
        """Bag seconds a second [1], 0 = as fast as the subscribers follow."""
        return self._time.rate

    def attach(self, publishers: PlayerPublishers) -> None:
        """Play on through these publishers from where it was left."""
        now = seconds_now()
        self._publishers = publishers
        self._earliest_s = now
        self._latest_s = now + self._settings.given.start_delay_s
        self._wait()

    def detach(self) -> None:
        """Stop; a message that could not leave yet is the next when it goes on."""
        publishers = self._publishers
        if publishers is not None and publishers.outbox and self.phase is Phase.PLAYING:
            self._reel.put_back()
        self._publishers, self.phase = None, Phase.CLOSED
        self._time.hold(seconds_now())
        self._answer_bursts()

    def close(self) -> None:
        """Close the bag."""
        self._reel.close()

    # -- playing

    def advance(self) -> None:
        """Publish what is due.

        Raises
        ------
        ValveTwinError
            If the bag cannot be read on or a real valve has come into reach.
        """
        publishers = self._publishers
        if publishers is None or not publishers.send(strict=self.rate == 0.0):
            return
        if self.phase is Phase.WAITING and self._is_released(publishers):
            self._jump(publishers)
        if self.phase is Phase.JUMPING and self._has_arrived(publishers):
            self._begin(publishers)
        if self.phase is Phase.PLAYING:
            (self._play_bursts if self.is_paused else self._play_due)(publishers)

    def publish_time(self) -> None:
        """Publish /clock by the hertz; never ahead of a message to come or the end."""
        publishers = self._publishers
        if (
            publishers is None
            or publishers.outbox
            or self.phase not in (Phase.PLAYING, Phase.ENDED)
        ):
            return
        coming, part = self._reel.next, self._reel.part
        latest_ns = part.end_ns if coming is None else coming.log_ns
        publishers.put_time(min(self._time.now_ns(seconds_now()), latest_ns))
        publishers.send(strict=False)

    def _play_due(self, publishers: PlayerPublishers) -> None:
        for _ in range(self._most):
            if self._reel.next is None:
                self._reach_end()
                return
            if not self._time.is_due(self._reel.next.log_ns, seconds_now()):
                return
            if not self._play_one(publishers):
                return

    def _play_bursts(self, publishers: PlayerPublishers) -> None:
        """Play what was asked for while paused."""
        for _ in range(self._most):
            if not self._bursts:
                return
            wanted, done, played = self._bursts[0]
            if self._reel.next is None or 0 < wanted <= played:
                self._bursts.pop(0)
                done(played)
                continue
            self._bursts[0] = (wanted, done, played + 1)
            if not self._play_one(publishers):
                return

    def _play_one(self, publishers: PlayerPublishers) -> bool:
        """Publish the next message; return whether another may follow now."""
        message = self._reel.take()
        if message is None:
            return False
        if self.is_paused or self.rate == 0.0:
            self._time.jump(message.log_ns, seconds_now())
        publishers.put(message)
        self.played += 1
        return publishers.send(strict=self.rate == 0.0)

    def _reach_end(self) -> None:
        self._say(f"end of the bag: {self.played} messages played")
        if self._settings.given.loop and self.played > self._round_began:
            self._round_began = self.played
            self._reel.go(self._settings.part)
            self._wait()
        else:
            self.phase = Phase.ENDED
            self._time.hold(seconds_now())

    # -- beginning, jumping

    def _wait(self) -> None:
        """Let everything be ready before the reel goes on."""
        self.phase = Phase.WAITING
        self._time.hold(seconds_now())
        self._earliest_s = max(self._earliest_s, seconds_now() + self._settings.given.delay_s)

    def _is_released(self, publishers: PlayerPublishers) -> bool:
        """Begin when the graph is settled and enough subscribers are there."""
        now, wanted = seconds_now(), self._settings.given.wait_for_subscribers
        if not publishers.is_settled(now):
            return False
        patient = now <= self._latest_s + MEET_S
        heard, met = publishers.are_heard(), publishers.has_matched_all()
        given_up = not wanted and now > self._latest_s and not (patient and not heard)
        enough = publishers.has_subscribers(wanted) or given_up
        if now < self._earliest_s or not enough or (patient and not met):
            return False
        publishers.check()
        publishers.find_subscribers()
        if not heard and not self.played:
            self._say(
                "nobody in sight subscribes to what is played; wait_for_subscribers: 1 waits for "
                "one (replay --wait-for-subscribers 1)"
            )
        return True

    def _jump(self, publishers: PlayerPublishers) -> None:
        """Go to where the reel stands once everything sent before has arrived."""
        publishers.outbox.clear()
        self.phase, self._jumped_s = Phase.JUMPING, seconds_now()

    def _has_arrived(self, publishers: PlayerPublishers) -> bool:
        return publishers.is_acked() or seconds_now() - self._jumped_s > JUMP_S

    def _begin(self, publishers: PlayerPublishers) -> None:
        """Publish the time and the state at the place where playing goes on."""
        now, coming = seconds_now(), self._reel.next
        if coming is not None:
            at_ns = self._time.now_ns(now)
            if not self._reel.part.begin_ns <= at_ns <= coming.log_ns:
                at_ns = self._reel.part.begin_ns  # a new round
            self._time.jump(at_ns, now)
            state = self._reel.state_before(at_ns)
            if state or self.is_paused or at_ns < coming.log_ns:
                publishers.put_time(at_ns)  # else it goes before the first message anyway
            for message in state:
                publishers.put(message, ticks=False)
        if not self.is_paused:
            self._time.run(now)
        self.phase = Phase.PLAYING

    # -- what is asked for

    def pause(self) -> None:
        """Let bag time stand."""
        self.is_paused = True
        self._time.hold(seconds_now())

    def resume(self) -> None:
        """Go on from where it stands."""
        self.is_paused = False
        self._answer_bursts()
        if self.phase is Phase.PLAYING:
            self._time.run(seconds_now())

    def set_rate(self, rate: float) -> bool:
        """Go on at another rate [1]; return whether it is one."""
        if not 0.0 < rate < math.inf:
            return False
        self._time.set_rate(rate, seconds_now())
        return True

    def burst(self, messages: int, done: Callable[[int], None]) -> None:
        """Play so many messages, 0 = all that is left, and tell how many it were."""
        if self.is_paused and self.phase in (Phase.WAITING, Phase.JUMPING, Phase.PLAYING):
            self._bursts.append((messages, done, 0))
        else:
            done(0)

    def seek(self, at_ns: int) -> bool:
        """Go on from a log time [ns]; return whether it lies in the bag."""
        end_ns = self._reel.part.end_ns
        is_inside = self._settings.whole.begin_ns <= at_ns <= end_ns
        if self.phase in (Phase.CLOSED, Phase.STOPPED) or not is_inside:
            return False
        try:
            self._go(Stretch(at_ns, end_ns))
        except BagError as err:
            self._say(f"not sought: {err}")
            return False
        return True

    def play(self, offset_ns: int, duration_ns: int, until_ns: int) -> bool:
        """Play a part of the bag once the last one has ended or was stopped.

        Parameters
        ----------
        offset_ns : int
            Begin this long after the first message [ns].
        duration_ns : int
            Bag time to play [ns], 0 or less = to the end.
        until_ns : int
            Log time to stop at [ns], 0 or less = the end. The earlier end counts.

        Returns
        -------
        bool
            False where the bag is being played already, or nothing lies in that part.
        """
        if self.phase not in (Phase.ENDED, Phase.STOPPED):
            return False
        try:
            self._go(self._settings.part_from(offset_ns, duration_ns, until_ns))
        except BagError as err:
            self._say(f"not played: {err}")
            return False
        self.played = self._round_began = 0
        self.is_paused = False
        return True

    def stop(self) -> None:
        """Stop; `play` begins again."""
        if self._publishers is None:
            return
        self.phase = Phase.STOPPED
        self._time.hold(seconds_now())
        self._publishers.outbox.clear()
        self._answer_bursts()

    def _go(self, part: Stretch) -> None:
        self._reel.go(part)
        self._time.jump(part.begin_ns, seconds_now())
        if self.phase is not Phase.WAITING and self._publishers is not None:
            self._time.hold(seconds_now())
            self._jump(self._publishers)

    def _answer_bursts(self) -> None:
        """Tell those who asked for more than they get."""
        for _, done, played in self._bursts:
            done(played)
        self._bursts = []
