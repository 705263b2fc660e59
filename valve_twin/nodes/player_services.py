# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The services of a player: names, fields and meaning as those of rosbag2's player."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from valve_twin_msgs import srv

from valve_twin.nodes.services import DeferredService, Done

if TYPE_CHECKING:
    from valve_twin.nodes.bag_player import BagPlayerNode


class PlayerServices:
    """Answers under the name of the player.

    Parameters
    ----------
    player : BagPlayerNode
        What they drive.
    """

    def __init__(self, player: BagPlayerNode) -> None:
        self._player = player
        for kind, name, callback in (
            (srv.Pause, "pause", self._on_pause),
            (srv.Resume, "resume", self._on_resume),
            (srv.TogglePaused, "toggle_paused", self._on_toggle),
            (srv.IsPaused, "is_paused", self._on_is_paused),
            (srv.SetRate, "set_rate", self._on_set_rate),
            (srv.GetRate, "get_rate", self._on_get_rate),
            (srv.Seek, "seek", self._on_seek),
            (srv.Stop, "stop", self._on_stop),
            (srv.Play, "play", self._on_play),
        ):
            player.create_service(kind, f"~/{name}", callback)
        DeferredService(player, srv.PlayNext, "~/play_next", self._on_play_next)
        DeferredService(player, srv.Burst, "~/burst", self._on_burst)

    def _on_pause(self, request: Any, response: Any) -> Any:
        del request
        self._player.pause()
        return response

    def _on_resume(self, request: Any, response: Any) -> Any:
        del request
        self._player.resume()
        return response

    def _on_toggle(self, request: Any, response: Any) -> Any:
        del request
        (self._player.resume if self._player.is_paused else self._player.pause)()
        return response

    def _on_is_paused(self, request: Any, response: Any) -> Any:
        del request
        response.paused = self._player.is_paused
        return response

    def _on_set_rate(self, request: Any, response: Any) -> Any:
        response.success = self._player.set_rate(float(request.rate))
        return response

    def _on_get_rate(self, request: Any, response: Any) -> Any:
        del request
        response.rate = self._player.rate
        return response

    def _on_seek(self, request: Any, response: Any) -> Any:
        response.success = self._player.seek(_nanoseconds(request.time))
        return response

    def _on_stop(self, request: Any, response: Any) -> Any:
        del request
        self._player.stop_playing()
        return response

    def _on_play(self, request: Any, response: Any) -> Any:
        response.success = self._player.play(
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

        self._player.burst(1, answer)

    def _on_burst(self, request: Any, response: Any, done: Done) -> None:
        def answer(played: int) -> None:
            response.actually_burst = played
            done(response)

        self._player.burst(int(request.num_messages), answer)


def _nanoseconds(time: Any) -> int:
    return int(time.sec) * 10**9 + int(time.nanosec)
