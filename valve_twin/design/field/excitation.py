# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The trapezoid of current that paper 000 identifies the dynamics with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.quantity import assumed, check_quantities

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray


@dataclass(frozen=True, slots=True)
class Trapezoid:
    """The first coil goes up, holds, down through its bias, holds, and back; the others hold.

    The paper's shape; it prints no numbers.
    """

    bias: float = assumed(1.0, "A", "Of every coil before and after", 0.0, 1e3)
    swing: float = assumed(1.0, "A", "Above and below it", 1e-6, 1e3)
    slope: float = assumed(4e-3, "s/A", "Of the flanks", 1e-7, 10.0)
    hold: float = assumed(4e-3, "s", "At each level", 0.0, 10.0)
    rest: float = assumed(5e-3, "s", "At the end", 0.0, 10.0)
    step: float = assumed(1e-4, "s", "Of the computation", 1e-7, 1e-2)

    def __post_init__(self) -> None:
        """Refuse numbers outside their range."""
        check_quantities(self)
        if self.swing > self.bias:
            message = f"swing = {self.swing:g}: must be at most the bias, {self.bias:g} [A]"
            raise ValueError(message)

    def record(self, coils: int) -> tuple[FloatArray, FloatArray]:
        """Return times (T,) [s] and currents (T, C) [A].

        Parameters
        ----------
        coils : int
            How many there are.
        """
        flank = self.slope * self.swing
        corners = np.cumsum([0.0, flank, self.hold, 2.0 * flank, self.hold, flank, self.rest])
        levels = self.bias + self.swing * np.array([0.0, 1.0, 1.0, -1.0, -1.0, 0.0, 0.0])
        count = max(2, round(float(corners[-1]) / self.step)) + 1
        time_s = np.linspace(0.0, corners[-1], count)
        currents = np.full((count, coils), self.bias)
        currents[:, 0] = np.interp(time_s, corners, levels)
        return time_s, currents
