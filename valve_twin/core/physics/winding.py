# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""An orthocyclic coil winding: layers, height and resistance from geometry (paper 000, eq. (3)).

    h = [1 + (zeta - 1) sin 60 deg] d_w        zeta = ceil(turns / floor(l_z / d_w))

The paper writes zeta as a function of the winding space's other side l_x; layers follow from its
length l_z along the axis, so l_z is taken, and l_x is what the height must fit into.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

COPPER = 1.72e-8
"""Resistivity of copper at 20 degrees Celsius [ohm m]."""

COPPER_RISE = 3.93e-3
"""Its relative rise with temperature [1/K]."""


@dataclass(frozen=True, slots=True)
class Winding:
    """A wound coil.

    Attributes
    ----------
    layers : int
        Layers of wire (zeta).
    height : float
        Height of all layers (h) [m].
    resistance : float
        At the given temperature [ohm].
    """

    layers: int
    height: float
    resistance: float


def wind(
    turns: int,
    wire: float,
    copper: float,
    length: float,
    inner_radius: float,
    *,
    temperature: float = 20.0,
) -> Winding:
    """Return layers, height and resistance of a winding.

    Parameters
    ----------
    turns : int
        Turns of the coil.
    wire, copper : float
        Diameter of the wire with and without its insulation [m].
    length : float
        Length of the winding space along the axis (l_z) [m].
    inner_radius : float
        Of the first layer [m].
    temperature : float
        Of the copper [degrees Celsius].

    Raises
    ------
    ValueError
        If a number is none of a winding; the message names it, its value and what is allowed.
    """
    if turns < 1:
        message = f"turns = {turns!r}: must be 1 or more"
        raise ValueError(message)
    limits = {
        "copper": (copper, 0.0, wire),
        "wire": (wire, 0.0, length),
        "inner_radius": (inner_radius, 0.0, math.inf),
    }
    for name, (value, lower, upper) in limits.items():
        if not lower < value <= upper:
            message = f"{name} = {value!r}: must be above {lower:g}, at most {upper:g} [m]"
            raise ValueError(message)
    a_layer = math.floor(length / wire)
    layers = math.ceil(turns / a_layer)
    height = (1.0 + (layers - 1) * math.sin(math.radians(60.0))) * wire
    metres = turns * 2.0 * math.pi * (inner_radius + 0.5 * height)
    hot = COPPER * (1.0 + COPPER_RISE * (temperature - 20.0))
    return Winding(layers, height, hot * metres / (0.25 * math.pi * copper**2))
