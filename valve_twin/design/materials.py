# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Materials of a magnetic circuit: linear, permanent magnet, saturating steel.

Steel by the closed form

    B = mu_0 H + J_s [ f (H/H_a) / (1 + (H/H_a)^p)^(1/p) + (1 - f) H/(H + H_b) ]

fitted to a public table of AISI 1008, or by a table of its own. The default numbers are those of
the fit: assumed for any other steel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.physics.solenoid_map import VACUUM
from valve_twin.core.quantity import assumed, check_quantities, quantity, setting

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

_MOST_FIELD = 1e6  # the closed form is followed up to here, mu_0 beyond [A/m]
_CURVE_POINTS = 4000
_MOST_STEEL = 4.0  # flux density of a table beyond that of vacuum, as `saturation`, assumed [T]
_STEEPEST = 1e6  # of a table over vacuum; none better is known, assumed [1]


@dataclass(frozen=True, slots=True)
class Linear:
    """Air, copper, plastics: B = mu_r mu_0 H."""

    permeability: float = quantity(1.0, "1", "Relative permeability", 1e-3, 1e8)
    conductivity: float = quantity(0.0, "S/m", "Of eddy currents; 0 = none", 0.0, 1e8)

    def __post_init__(self) -> None:
        """Refuse numbers outside their range."""
        check_quantities(self)


@dataclass(frozen=True, slots=True)
class Magnet:
    """Permanent magnet: B = B_r + mu_r mu_0 H along its direction, positive towards +r or +z."""

    remanence: float = assumed(1.1, "T", "Remanent flux density, negative = reversed", -2.0, 2.0)
    permeability: float = assumed(1.05, "1", "Relative recoil permeability", 1.0, 10.0)
    conductivity: float = quantity(0.0, "S/m", "Of eddy currents; 0 = none", 0.0, 1e8)
    direction: str = setting("axial", "Of the magnetisation", choices=("axial", "radial"))

    def __post_init__(self) -> None:
        """Refuse numbers outside their range."""
        check_quantities(self)


@dataclass(frozen=True, slots=True)
class Steel:
    """Saturating steel without hysteresis; a table of B over H replaces the closed form."""

    saturation: float = assumed(2.1076, "T", "J_s of the closed form", 0.1, 4.0)
    knee: float = assumed(482.2, "A/m", "H_a of the closed form", 1.0, 1e5)
    sharpness: float = assumed(2.919, "1", "p of the closed form", 0.5, 20.0)
    share: float = assumed(0.636, "1", "f of the closed form", 0.0, 1.0)
    approach: float = assumed(6127.0, "A/m", "H_b of the closed form", 1.0, 1e6)
    conductivity: float = assumed(5.8e6, "S/m", "Of eddy currents; 0 = none", 0.0, 1e8)
    table_h: tuple[float, ...] = quantity((), "A/m", "Field strengths of a table, from 0")
    table_b: tuple[float, ...] = quantity((), "T", "Flux densities of a table, from 0")

    def __post_init__(self) -> None:
        """Refuse numbers outside their range and a table that is no magnetisation curve."""
        check_quantities(self)
        check_table(self.table_h, self.table_b)

    def curve(self) -> tuple[FloatArray, FloatArray]:
        """Return field strength [A/m] and flux density [T], (N,) each, from 0 and rising."""
        if self.table_b:
            return np.array(self.table_h), np.array(self.table_b)
        h = np.concatenate([[0.0], np.geomspace(1e-3, _MOST_FIELD, _CURVE_POINTS)])
        return h, self.flux_density(h)

    def flux_density(self, h: FloatArray) -> FloatArray:
        """Return the closed form's flux density [T] at field strengths (N,) from 0 [A/m]."""
        part = h / self.knee
        bend = part / (1.0 + part**self.sharpness) ** (1.0 / self.sharpness)
        far = h / (h + self.approach)
        found: FloatArray = VACUUM * h + self.saturation * (
            self.share * bend + (1.0 - self.share) * far
        )
        return found


Material = Linear | Magnet | Steel

AIR = "air"
"""Name of the material of all that no region covers."""


def check_table(h: tuple[float, ...], b: tuple[float, ...]) -> None:
    """Refuse what is no magnetisation curve.

    Raises
    ------
    ValueError
        Names the place and the value.
    """
    if len(h) != len(b) or len(b) in {1, 2}:
        message = f"table_h has {len(h)} values, table_b {len(b)}: must be as many, 3 or more"
        raise ValueError(message)
    if not b:
        return
    if h[0] != 0.0 or b[0] != 0.0:
        message = f"table_h[0] = {h[0]:g}, table_b[0] = {b[0]:g}: a table begins with 0 and 0"
        raise ValueError(message)
    for name, values, unit in (("table_h", h, "A/m"), ("table_b", b, "T")):
        for k in range(1, len(values)):
            if not values[k] > values[k - 1]:
                message = f"{name}[{k}] = {values[k]:g} {unit} after {values[k - 1]:g}: must rise"
                raise ValueError(message)
    slope = np.diff(b) / np.diff(h)
    low = np.flatnonzero(slope < VACUUM * (1.0 - 1e-9))
    if len(low):
        k = int(low[0]) + 1
        message = (
            f"table_b[{k}] = {b[k]:g} T at {h[k]:g} A/m: rises by {slope[k - 1]:.3g} H/m, less "
            f"than vacuum, {VACUUM:.4g}"
        )
        raise ValueError(message)
    beyond = np.array(b) - VACUUM * np.array(h)
    if (beyond > _MOST_STEEL).any():
        k = int(np.argmax(beyond > _MOST_STEEL))
        message = (
            f"table_b[{k}] = {b[k]:g} T at {h[k]:g} A/m: {beyond[k]:.3g} T beyond that of vacuum; "
            f"must be at most {_MOST_STEEL:g}: is it in tesla?"
        )
        raise ValueError(message)
    if (slope > _STEEPEST * VACUUM).any():
        k = int(np.argmax(slope > _STEEPEST * VACUUM)) + 1
        message = (
            f"table_b[{k}] = {b[k]:g} T at {h[k]:g} A/m: rises by {slope[k - 1]:.3g} H/m, "
            f"{slope[k - 1] / VACUUM:.3g} times vacuum; must be at most {_STEEPEST:g}: is the "
            "field in A/m?"
        )
        raise ValueError(message)
