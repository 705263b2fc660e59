# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Currents of coils: what they bear, and the trapezoid that paper 000 identifies with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.quantity import assumed, check_quantities
from valve_twin.design.geometry.section import area

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray
    from valve_twin.design.geometry.section import Section

DENSITY = 1e9
"""Of a current over its winding at most: copper melts within 0.1 s, assumed [A/m^2]."""

_MOST_TIMES = 100_000  # of a record: an hour on a coarse mesh, assumed


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

        Raises
        ------
        ValueError
            If these are more times than can be computed.
        """
        flank = self.slope * self.swing
        corners = np.cumsum([0.0, flank, self.hold, 2.0 * flank, self.hold, flank, self.rest])
        levels = self.bias + self.swing * np.array([0.0, 1.0, 1.0, -1.0, -1.0, 0.0, 0.0])
        count = max(2, round(float(corners[-1]) / self.step)) + 1
        if count > _MOST_TIMES:
            message = (
                f"step = {self.step:g}: {count:.6g} times over {corners[-1]:.6g} s; must be "
                f"{corners[-1] / _MOST_TIMES:.3g} or more [s]"
            )
            raise ValueError(message)
        time_s = np.linspace(0.0, corners[-1], count)
        currents = np.full((count, coils), self.bias)
        currents[:, 0] = np.interp(time_s, corners, levels)
        return time_s, currents


def check_currents(section: Section, currents: FloatArray) -> None:
    """Refuse currents that no coil bears.

    Parameters
    ----------
    section : Section
        With its coils.
    currents : (..., C) array
        Of the coils in the order of `Section.coils` [A].

    Raises
    ------
    ValueError
        Names coil, current and range.
    """
    for region in section.regions:
        if not region.coil or not region.turns:
            continue
        most = DENSITY * area(region.outline) / abs(region.turns)
        of = np.ravel(currents[..., section.coils.index(region.coil)])
        worst = float(of[np.argmax(np.abs(of))])
        if not abs(worst) <= most * (1.0 + 1e-9):
            message = (
                f"current of {region.coil} = {worst:g}: must be from {-most:.3g} to {most:.3g} [A]"
                f", {DENSITY:g} A/m^2 of its winding"
            )
            raise ValueError(message)
