# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The services of a player: names, fields and meaning as those of rosbag2's player."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from valve_twin_msgs import srv

from valve_twin.nodes.runtime.services import DeferredService, Done, create_pause_services

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

    from valve_twin.nodes.player.playback import Playback


class PlayerServices:
    """Answers under the name of the player; without a bag there is nothing to be driven.

    Parameters
    ----------
    node : Node
        The player.
    playback : callable
        Returns what they drive, None without a bag.
    rate : callable
        Returns the rate that a bag would be played at [1].
    stop : callable
        Stops playing.
    """

    def __init__(
        self,
        node: Node,
        *,
        playback: Callable[[], Playback | None],
        rate: Callable[[], float],
        stop: Callable[[], None],
    ) -> None:
        self._find, self._rate, self._stop = playback, rate, stop
        for kind, name, callback in (
            (srv.SetRate, "set_rate", self._on_set_rate),
            (srv.GetRate, "get_rate", self._on_get_rate),
            (srv.Seek, "seek", self._on_seek),
            (srv.Stop, "stop", self._on_stop),
            (srv.Play, "play", self._on_play),
        ):
            node.create_service(kind, f"~/{name}", callback)
        create_pause_services(node, self._is_paused, self._pause)
        DeferredService(node, srv.PlayNext, "~/play_next", self._on_play_next)
        DeferredService(node, srv.Burst, "~/burst", self._on_burst)

    @property
    def _playback(self) -> Playback | None:
        return self._find()

    def _is_paused(self) -> bool:
        return self._playback is None or self._playback.is_paused

    def _pause(self, paused: bool) -> None:
        if self._playback is not None:
            (self._playback.pause if paused else self._playback.resume)()

    def _on_set_rate(self, request: Any, response: Any) -> Any:
        playback = self._playback
        response.success = playback is not None and playback.set_rate(float(request.rate))
        return response

    def _on_get_rate(self, request: Any, response: Any) -> Any:
        del request
        playback = self._playback
        response.rate = playback.rate if playback else self._rate()
        return response

    def _on_seek(self, request: Any, response: Any) -> Any:
        playback = self._playback
        response.success = playback is not None and playback.seek(_nanoseconds(request.time))
        return response

    def _on_stop(self, request: Any, response: Any) -> Any:
        del request
        self._stop()
        return response

    def _on_play(self, request: Any, response: Any) -> Any:
        playback = self._playback
        response.success = playback is not None and playback.play(
            _nanoseconds(request.start_offset),
            _nanoseconds(request.playback_duration),
            _nanoseconds(request.playback_until_timestamp),
        )
        return response

    def _on_play_next(self, request: Any, response: Any, done: Done) -> None:
        del request

        def answer(played: int) -> None:
            response.success = played == 1
            done(response)

        self._burst(1, answer)

    def _on_burst(self, request: Any, response: Any, done: Done) -> None:
        def answer(played: int) -> None:
            response.actually_burst = played
            done(response)

        self._burst(int(request.num_messages), answer)

    def _burst(self, messages: int, answer: Any) -> None:
        if self._playback is None:
            answer(0)
        else:
            self._playback.burst(messages, answer)


def _nanoseconds(time: Any) -> int:
    return int(time.sec) * 10**9 + int(time.nanosec)
