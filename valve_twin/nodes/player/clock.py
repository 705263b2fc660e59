# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The time of a bag as it is played: runs at a rate, stands while paused, jumps on a seek."""

from __future__ import annotations


class PlaybackClock:
    """Bag time as a function of a steady clock.

    Every method takes the steady clock [s]. A pause and a change of rate leave no step.

    Parameters
    ----------
    rate : float
        Bag seconds a second [1]; 0 = bag time is that of the last message.
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._bag_ns = 0
        self._since_s: float | None = None

    @property
    def rate(self) -> float:
        """Bag seconds a second [1], 0 = as fast as messages leave."""
        return self._rate

    def now_ns(self, now_s: float) -> int:
        """Return the bag time [ns]."""
        if self._since_s is None or self._rate == 0.0:
            return self._bag_ns
        return self._bag_ns + round((now_s - self._since_s) * self._rate * 1e9)

    def is_due(self, log_ns: int, now_s: float) -> bool:
        """Return whether a message of that log time [ns] is to be published."""
        return self._rate == 0.0 or log_ns <= self.now_ns(now_s)

    def jump(self, bag_ns: int, now_s: float) -> None:
        """Go on from another bag time [ns]."""
        self._bag_ns = bag_ns
        if self._since_s is not None:
            self._since_s = now_s

    def run(self, now_s: float) -> None:
        """Let time pass from where it stands."""
        if self._since_s is None:
            self._since_s = now_s

    def hold(self, now_s: float) -> None:
        """Let time stand where it is."""
        self._bag_ns = self.now_ns(now_s)
        self._since_s = None

    def set_rate(self, rate: float, now_s: float) -> None:
        """Go on at another rate [1] from the present bag time."""
        self.jump(self.now_ns(now_s), now_s)
        self._rate = rate
