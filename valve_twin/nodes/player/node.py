# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The bag player node: publishes a bag again, under a prefix, with /clock, in one order.

One queue holds the messages of all topics, so that their order is that of the bag at any rate.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from valve_twin.io.config.node_parameters import BagPlayerParameters
from valve_twin.io.errors import BagError, IndexLiesError, ValveTwinError
from valve_twin.io.playback.player import bag_topics
from valve_twin.nodes.player.playback import Phase, Playback
from valve_twin.nodes.player.publishers import PlayerPublishers
from valve_twin.nodes.player.services import PlayerServices
from valve_twin.nodes.player.settings import PlaybackSettings, read_settings
from valve_twin.nodes.runtime.log_bridge import LogBridge
from valve_twin.nodes.runtime.node import STEADY, ValveNode, run
from valve_twin.nodes.runtime.safety import CHECK_S
from valve_twin.nodes.runtime.transport.profile import has_fast_heartbeat, use_fast_heartbeat
from valve_twin.nodes.twin.inputs import seconds_now

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

TICK_S = 0.002
"""Period of the pacing timer [s]."""

MOST_MESSAGES = 128
"""Messages published in one tick: a callback has to end soon."""

MOST_SLOWLY = 32
"""The same where shared memory must not overflow, because what it drops is sent again seconds
later."""


class BagPlayerNode(ValveNode):
    """Lifecycle node that plays one bag."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("bag_player", **kwargs)
        self._settings: PlaybackSettings | None = None
        self.playback: Playback | None = None
        self._player_publishers: PlayerPublishers | None = None
        self._bridge: LogBridge | None = None
        self._timers_made: list[Any] = []
        self._ended_s: float | None = None
        PlayerServices(
            self,
            playback=lambda: self.playback,
            rate=lambda: self._given.rate,
            stop=self.stop_playing,
        )

    @property
    def _given(self) -> BagPlayerParameters:
        """The parameters as they are now."""
        return self.parameters.read(BagPlayerParameters)

    def start(self) -> None:
        """Start; a player that cannot play ends where it would end after playing."""
        super().start()
        if self._given.exit_at_end and self.state != "active":
            self.exit_code = 1

    def configure(self) -> None:
        """Open the bag."""
        self.parameters.warn_unknown(hosts_valves=False)
        self.parameters.check()
        logger = self.get_logger()
        self._bridge = LogBridge(logger)
        try:
            self._open()
        except IndexLiesError:  # what is wrong has been said; it is known from now on
            self._open()

    def _open(self) -> None:
        logger, where = self.get_logger(), self.get_fully_qualified_name()
        settings = read_settings(self.parameters, where, logger.warning, logger.info)
        most = MOST_MESSAGES if has_fast_heartbeat() else MOST_SLOWLY
        self.playback = Playback(settings, most, logger.info, logger.warning)
        self._settings = settings

    def activate(self) -> None:
        """Check that no real valve is in reach, then play."""
        assert self._settings is not None
        assert self.playback is not None
        self._player_publishers = PlayerPublishers(self, self._settings)
        self._ended_s = None
        self.playback.attach(self._player_publishers)
        self._timers_made = [
            self.create_timer(TICK_S, self._tick, clock=STEADY),
            self.create_timer(CHECK_S, self._watch, clock=STEADY),
        ]
        if self._settings.given.clock_hz:
            period_s = 1.0 / self._settings.given.clock_hz
            timer = self.create_timer(period_s, self._publish_time, clock=STEADY)
            self._timers_made.append(timer)

    def deactivate(self) -> None:
        """Stop publishing; activating again goes on from here."""
        for timer in self._timers_made:
            self.destroy_timer(timer)
        self._timers_made = []
        if self.playback is not None:
            self.playback.detach()
        if self._player_publishers is not None:
            self._player_publishers.close()
        self._player_publishers = None

    def cleanup(self) -> None:
        """Close the bag."""
        for part in (self.playback, self._bridge):
            if part is not None:
                part.close()
        self._settings = self.playback = self._bridge = None

    def stop_playing(self) -> None:
        """Stop, and end the process where that is wanted at the end."""
        if self.playback is not None:
            self.playback.stop()
        if self._player_publishers is not None and self._given.exit_at_end:
            self.exit_code = 0

    def _tick(self) -> None:
        """Play on, to the end."""
        playback = self.playback
        if playback is None:
            return
        self._unless_refused(playback.advance)
        if playback.phase is Phase.ENDED and self._given.exit_at_end:
            self._end()

    def _publish_time(self) -> None:
        if self.playback is not None:
            self._unless_refused(self.playback.publish_time)

    def _watch(self) -> None:
        """Look at the graph again."""
        if self._player_publishers is not None:
            self._unless_refused(self._player_publishers.check)

    def _unless_refused(self, action: Callable[[], None]) -> None:
        """Do it; a bag that cannot be read on or a real valve that came into reach ends it all.

        Such a bag is let go, too: whoever activates again would get the end of it in silence.
        """
        try:
            action()
        except ValveTwinError as err:
            self.get_logger().error(f"stopped: {err}")
            self.trigger_deactivate()
            if isinstance(err, BagError):
                self.trigger_cleanup()
            if self._given.exit_at_end:
                self.exit_code = 1

    def _end(self) -> None:
        """End the process when all subscribers have what was played."""
        now = seconds_now()
        self._ended_s = now if self._ended_s is None else self._ended_s
        late = now - self._ended_s > self._given.acked_wait_s
        if late or self._player_publishers is None or self._player_publishers.is_acked():
            self.exit_code = 0


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
    use_fast_heartbeat(over_udp=True)
    values = {"bag": bag, "rate": float(rate), "publish_prefix": prefix, "clock": clock}
    given = [f"{name}:={json.dumps(v)}" for name, v in {**values, **(more or {})}.items()]
    arguments = [a for g in (*given, "exit_at_end:=true") for a in ("-p", g)]
    return run(BagPlayerNode, ["--ros-args", *arguments])
