# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""One pole of paper 001's actuator: a coil and a standing magnet that pull one flat armature.

The armature lies over three faces: the core (the paper's former, a hollow cylinder through the
coil), the shoe of a ring magnet around it, and the cover plate outside the coil. The coil's flux
goes through core, armature, cover plate, yoke and base plate, that of the magnet from its shoe
through the armature into core and cover plate: neither has to pass through the other's source.
The gap Ga1 between core and magnet keeps the magnet from being shorted.

Widths and heights are printed (section 3.3); how the parts lie to each other is not (Fig. 1 has no
scale): that reading and the numbers marked assumed are ours. z = 0 is the plane of the faces.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from valve_twin.core.quantity import assumed, check_quantities, quantity
from valve_twin.design.geometry.section import Motion, Region, Section, rectangle
from valve_twin.design.materials import Magnet, Steel

_INSULATION = 0.5e-3  # around the winding [m], assumed
_BOX = 2.0  # radius of the box over that of the yoke [1]
_ABOVE = 10e-3  # air that is stretched above the armature [m]


@dataclass(frozen=True, slots=True)
class HybridPole:
    """Dimensions of the pole; radial unless they say otherwise."""

    armature_width: float = quantity(22e-3, "m", "Of the armature's disc", 1e-3, 0.2)
    armature_thickness: float = quantity(5e-3, "m", "Of the disc, axial", 2e-4, 0.1)
    magnet_height: float = quantity(50e-3, "m", "Of the ring magnet, axial", 1e-3, 0.2)
    magnet_thickness: float = quantity(4e-3, "m", "Of its wall", 2e-4, 0.05)
    yoke_height: float = quantity(55.5e-3, "m", "Faces above the base plate, axial", 5e-3, 0.3)
    yoke_width: float = quantity(3e-3, "m", "Of the yoke's wall", 2e-4, 0.05)
    base_thickness: float = quantity(5e-3, "m", "Of the base plate, axial", 2e-4, 0.05)
    base_width: float = quantity(27e-3, "m", "Of the base plate to the yoke's outside", 5e-3, 0.2)
    cover_width: float = quantity(17.5e-3, "m", "Of the cover plate", 5e-4, 0.2)
    cover_thickness: float = quantity(9e-3, "m", "Of the cover plate, axial", 2e-4, 0.1)
    gap_1: float = quantity(1e-3, "m", "Ga1: between core and magnet", 1e-5, 0.02)
    gap_2: float = quantity(0.2e-3, "m", "Ga2: between cover plate and yoke", 0.0, 0.02)
    gap_3: float = quantity(0.5e-3, "m", "Ga3: under the core and the magnet, axial", 0.0, 0.02)
    gap_4: float = quantity(0.0, "m", "Ga4: between yoke and base plate, axial", 0.0, 0.02)
    hole: float = assumed(4e-3, "m", "Radius of the stem's hole; the paper says hole of 8 mm",
                          5e-4, 0.05)  # fmt: skip
    core: float = assumed(14e-3, "m", "Outer radius of the core", 1e-3, 0.1)
    base_from: float = assumed(16.5e-3, "m", "Radius from which the base's width counts",
                               1e-3, 0.1)  # fmt: skip
    shoe: float = assumed(1e-3, "m", "Thickness of the magnet's shoe, axial", 1e-4, 0.05)
    gap: float = quantity(0.5e-3, "m", "Working gap, armature above the faces", 1e-5, 0.1)
    magnet: Magnet = field(default_factory=lambda: Magnet(remanence=1.23, permeability=1.1))
    steel: Steel = field(default_factory=Steel)

    def __post_init__(self) -> None:
        """Refuse numbers outside their range."""
        check_quantities(self)

    @property
    def outside(self) -> float:
        """Outer radius of yoke and base plate [m]."""
        return self.base_from + self.base_width

    @property
    def magnet_radii(self) -> tuple[float, float]:
        """Inner and outer radius of the magnet [m]."""
        inner = self.core + self.gap_1
        return inner, inner + self.magnet_thickness

    @property
    def cover_radii(self) -> tuple[float, float]:
        """Inner and outer radius of the cover plate [m]."""
        outer = self.outside - self.yoke_width - self.gap_2
        return outer - self.cover_width, outer

    def section(self) -> Section:
        """Return the half section; the coil has 1 turn, so that a current is an m.m.f. [A].

        Raises
        ------
        ValueError
            If parts do not fit into each other; names the dimension, its value and the range.
        """
        gap, (inner, outer) = self.gap, self.magnet_radii
        cover = self.cover_radii
        reach = self.hole + self.armature_width
        foot = self.yoke_height + self.gap_4 - self.gap_3
        _check("core", self.core, self.hole + 5e-4, 1.0)
        _check("magnet_height", self.magnet_height, 0.0, foot - self.shoe - 1e-4)
        more = outer + 2.0 * _INSULATION + 1e-4 - cover[1]  # for a coil of 0.1 mm
        _check("base_width", self.base_width, self.base_width + more, 1.0)
        _check("cover_width", self.cover_width, 0.0, cover[1] - outer - 1e-4)
        _check("armature_width", self.armature_width, outer - self.hole, 1.0)
        _check("cover_thickness", self.cover_thickness, 0.0, self.yoke_height - 5e-3)
        top, bottom = -self.shoe, -self.shoe - self.magnet_height
        base = -self.yoke_height - self.gap_4
        window = rectangle(outer + _INSULATION, cover[1] - _INSULATION, base + _INSULATION,
                           -self.cover_thickness - _INSULATION)  # fmt: skip
        pieces = {
            "armature": rectangle(self.hole, reach, gap, gap + self.armature_thickness),
            "core": rectangle(self.hole, self.core, -foot, 0.0),
            "shoe": rectangle(inner, outer, top, 0.0),
            "magnet": rectangle(inner, outer, bottom, top),
            "foot": rectangle(inner, outer, -foot, bottom),
            "base": rectangle(self.hole, self.outside, base - self.base_thickness, base),
            "yoke": rectangle(self.outside - self.yoke_width, self.outside, -self.yoke_height, 0),
            "cover": rectangle(*cover, -self.cover_thickness, 0.0),
        }
        regions = [Region(name, "magnet" if name == "magnet" else "steel", outline)
                   for name, outline in pieces.items()]  # fmt: skip
        regions.append(Region("coil", "air", window, "A", 1.0))
        still = max(reach, self.outside) + 5e-3
        high = gap + self.armature_thickness
        motion = Motion(reach, still, gap, high, 0.0, high + _ABOVE, 0.0)
        box = _BOX * still
        return Section("hybrid pole", tuple(regions), {"steel": self.steel, "magnet": self.magnet},
                       motion, box, base - box, high + box)  # fmt: skip


def _check(name: str, value: float, lower: float, upper: float) -> None:
    """Refuse a dimension that does not fit to the others [m]."""
    if not lower <= value <= upper:
        message = f"{name} = {value:.6g}: must be from {lower:.6g} to {upper:.6g} [m]"
        raise ValueError(message)
