# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a history keeps of every cycle, and from when on the others are condensed."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Retention:
    """What is kept of every cycle.

    Attributes
    ----------
    cycles : int
        Newest cycles of a valve that are kept [1], `condense.LEAST` at least; 0 = as days say.
    days : float
        Age up to which cycles are kept, counted from the valve's newest ones [d]; 0 = as cycles
        say. What either keeps is kept.
    hours_for_days : float
        Age up to which hours are kept beside days, likewise [d].
    """

    cycles: int = 0
    days: float = 0.0
    hours_for_days: float = 90.0

    def wrong(self) -> str:
        """Return what is wrong with it, empty where nothing is."""
        if not (self.cycles or self.days):
            return "it is not said what is kept: give a number of cycles or of days"
        if not 0 <= self.cycles <= _MOST_CYCLES:
            return f"cycles that are kept are 0 to {_MOST_CYCLES}"
        if not 0.0 <= self.days <= _MOST_DAYS:
            return f"days that are kept are 0 to {_MOST_DAYS}"
        if not 0.0 <= self.hours_for_days <= _MOST_DAYS:
            return f"days for which hours are kept are 0 to {_MOST_DAYS}"
        return ""


_MOST_CYCLES = 10**12
_MOST_DAYS = 100_000  # 270 years: their stamps are still 64 bits wide
