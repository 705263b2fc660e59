# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How a plant parameter changes over the cycles."""

from __future__ import annotations

import math
from dataclasses import dataclass

from valve_twin.core.quantity import quantity, setting

LAWS = ("none", "linear", "exponential", "step")


@dataclass(frozen=True, slots=True)
class AgingRule:
    """One parameter that ages.

    Attributes
    ----------
    parameter : str
        Name of a plant parameter, e.g. "area_in".
    law : str
        "linear": 1 + rate n; "exponential": (1 + rate)^n; "step": 1 + rate; "none": 1. n counts
        the cycles from `start_cycle` on, 1 in the first.
    rate : float
        Relative change a cycle, for "step" once [1].
    start_cycle : int
        First cycle that ages.
    """

    parameter: str
    law: str = setting("linear", "How it changes.", choices=LAWS)
    rate: float = quantity(0.0, "1", "Relative change a cycle, for step once.")
    start_cycle: int = quantity(1, "1", "First cycle that ages.")

    def __post_init__(self) -> None:
        """Refuse an unknown law or a rate that is not a number."""
        if self.law not in LAWS:
            message = (
                f"aging of {self.parameter}: law = {self.law!r}: must be one of {', '.join(LAWS)}"
            )
            raise ValueError(message)
        if not (math.isfinite(self.rate) and -1.0 < self.rate < 10.0):
            message = (
                f"aging of {self.parameter}: rate = {self.rate!r}: must be between -1 and 10 [1]"
            )
            raise ValueError(message)
        if self.start_cycle < 0:
            message = (
                f"aging of {self.parameter}: start_cycle = {self.start_cycle!r}: "
                "must not be negative"
            )
            raise ValueError(message)

    def factor(self, cycle: int) -> float:
        """Return the factor on the parameter in a cycle [1], never below 0."""
        count = cycle - self.start_cycle + 1
        if count <= 0 or self.law == "none":
            return 1.0
        if self.law == "linear":
            return max(1.0 + self.rate * count, 0.0)
        if self.law == "exponential":
            return float(math.exp(min(count * math.log1p(self.rate), 700.0)))
        return 1.0 + self.rate
