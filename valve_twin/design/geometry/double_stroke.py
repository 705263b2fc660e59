# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A double-stroke solenoid, as paper 000's valve has one: two coils, one armature between poles.

Symmetric about z = 0; coil A stands at z > 0 and draws the armature towards +z. Between coil and
armature lies a tube: magnetic in the middle (collar), not magnetic (bridge), magnetic again where
the pole's rim reaches over the end of the armature (the control edge, a cone). Both fluxes return
through a ring between the coils, whose m.m.f. oppose each other.

One dimension is absolute, the others are relative, so that a change of one leaves a solenoid. The
paper prints no dimensions: all numbers are assumed, sized to a valve of size 6.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

from valve_twin.core.physics.winding import Winding, wind
from valve_twin.core.quantity import assumed, describe
from valve_twin.core.valves.designed import Surroundings
from valve_twin.design.geometry.section import Motion, Region, Section, mirrored, rectangle
from valve_twin.design.geometry.wires import Wire, find_wire
from valve_twin.design.materials import Steel

if TYPE_CHECKING:
    from valve_twin.design.geometry.section import Outline

_DENSITY = 7850.0  # of steel [kg/m^3]
_MOST_STROKE = 0.8  # of the working gap: the air in it is stretched, not meshed anew [1]
_BOX = 1.6  # radius of the box over that of the yoke; z alike [1]


@dataclass(frozen=True, slots=True)
class Violation:
    """A restriction that a geometry breaks.

    Attributes
    ----------
    name : str
        What is restricted.
    value, lower, upper : float
        Its value and allowed range [unit].
    unit : str
        Unit.
    """

    name: str
    value: float
    lower: float
    upper: float
    unit: str

    @property
    def by(self) -> float:
        """How far the value lies outside its range [unit]."""
        return max(self.lower - self.value, self.value - self.upper)

    def __str__(self) -> str:
        """Return one line: what, value, range, by how much."""
        low, high = math.isfinite(self.lower), math.isfinite(self.upper)
        allowed = f"{self.lower:.6g} to {self.upper:.6g}" if low and high else (
            f"{self.lower:.6g} or more" if low else f"{self.upper:.6g} or less"
        )  # fmt: skip
        return (
            f"{self.name} = {self.value:.6g}: must be {allowed} [{self.unit}], "
            f"off by {self.by:.3g}"
        )


@dataclass(frozen=True, slots=True)
class DoubleStroke:
    """Dimensions of a double-stroke solenoid; feasible or not, see `violations`."""

    armature_radius: float = assumed(8e-3, "m", "Outer radius of the armature", 1e-3, 0.1)
    rod_ratio: float = assumed(
        0.25, "1", "Radius of the rod, not magnetic, over that of the armature", 0.05, 0.8
    )
    armature_ratio: float = assumed(3.0, "1", "Length over radius of the armature", 0.5, 10.0)
    gap_ratio: float = assumed(
        0.1875, "1", "Working gap in the middle over the armature's radius", 0.02, 1.0
    )
    slide_ratio: float = assumed(
        0.03125, "1", "Radial sliding gap over the armature's radius", 0.005, 0.2
    )
    tube_ratio: float = assumed(
        0.21875, "1", "Wall of the tube over the armature's radius", 0.03, 1.0
    )
    overlap_ratio: float = assumed(
        1.0 / 3.0, "1", "How far the rim reaches over the armature's end, over the gap", 0.02, 3.0
    )
    tip_ratio: float = assumed(
        0.4 / 1.75, "1", "Thickness of the rim at its tip over the tube's wall", 0.02, 0.95
    )
    ring_ratio: float = assumed(
        0.25, "1", "Length of the ring between the coils over the armature's", 0.02, 0.9
    )
    collar_ratio: float = assumed(
        1.0 / 3.0, "1", "Length of the tube's magnetic middle over the armature's", 0.02, 0.95
    )
    coil_ratio: float = assumed(
        2.25, "1", "Length of a winding over the armature's radius", 0.2, 10.0
    )
    window_ratio: float = assumed(
        1.1875, "1", "Depth of the winding space over the armature's radius", 0.05, 5.0
    )
    bobbin_ratio: float = assumed(
        0.125, "1", "Insulation at a coil's ends over the armature's radius", 0.01, 1.0
    )
    former_ratio: float = assumed(
        0.0625, "1", "Insulation below and above a coil over the armature's radius", 0.01, 1.0
    )
    flange_ratio: float = assumed(
        0.5, "1", "Thickness of the end flanges over the armature's radius", 0.05, 3.0
    )
    yoke_ratio: float = assumed(0.5, "1", "Wall of the yoke over the armature's radius", 0.05, 3.0)
    stroke_ratio: float = assumed(2.0 / 3.0, "1", "Stroke to one side over the gap", 0.0, 1.0)
    turns: int = assumed(375, "1", "Turns of a coil", 1, 100000)
    wire: float = assumed(0.63e-3, "m", "Diameter of the bare wire", 2e-5, 5e-3)
    wire_grade: int = assumed(1, "1", "Grade of its enamel", 1, 2)
    wire_overall: float = assumed(
        0.0, "m", "Diameter with enamel of a wire outside the standard, 0 = by the standard", 0.0,
        6e-3,
    )  # fmt: skip
    spool_mass: float = assumed(0.045, "kg", "What moves with the armature", 0.0, 10.0)
    steel: Steel = field(default_factory=Steel)
    valve: Surroundings = field(default_factory=Surroundings)

    @property
    def gap(self) -> float:
        """Working gap of each side in the middle [m]."""
        return self.gap_ratio * self.armature_radius

    @property
    def stroke(self) -> float:
        """Stroke to either side [m]."""
        return self.stroke_ratio * self.gap

    @property
    def face(self) -> float:
        """Where a pole's face stands on the axis [m]."""
        return 0.5 * self.armature_ratio * self.armature_radius + self.gap

    @property
    def rim_tip(self) -> float:
        """Where the tip of a pole's rim stands on the axis [m]."""
        return self.face - (1.0 + self.overlap_ratio) * self.gap

    @property
    def collar(self) -> float:
        """Half the length of the tube's magnetic middle [m]."""
        return 0.5 * self.collar_ratio * self.armature_ratio * self.armature_radius

    @property
    def ring(self) -> float:
        """Half the length of the ring [m]."""
        return 0.5 * self.ring_ratio * self.armature_ratio * self.armature_radius

    @property
    def coil_ends(self) -> tuple[float, float]:
        """Where the winding of coil A begins and ends on the axis [m]."""
        begin = self.ring + self.bobbin_ratio * self.armature_radius
        return begin, begin + self.coil_ratio * self.armature_radius

    @property
    def flange(self) -> float:
        """Where the flange of coil A begins on the axis [m]."""
        return self.coil_ends[1] + self.bobbin_ratio * self.armature_radius

    @property
    def tube(self) -> tuple[float, float]:
        """Inner and outer radius of the tube [m]."""
        inner = (1.0 + self.slide_ratio) * self.armature_radius
        return inner, inner + self.tube_ratio * self.armature_radius

    @property
    def window(self) -> tuple[float, float]:
        """Inner and outer radius of the winding space [m]."""
        inner = self.tube[1] + self.former_ratio * self.armature_radius
        return inner, inner + self.window_ratio * self.armature_radius

    def standard_wire(self) -> Wire:
        """Return the wire's diameters.

        Raises
        ------
        ValueError
            If the standard has no such wire and no overall diameter is given.
        """
        if self.wire_overall:
            return Wire(self.wire, self.wire_overall)
        return find_wire(self.wire, self.wire_grade)

    def winding(self, temperature: float = 20.0) -> Winding:
        """Return layers, height and resistance of a coil, paper 000, eq. (3).

        Parameters
        ----------
        temperature : float
            Of the copper [degrees Celsius].
        """
        wire = self.standard_wire()
        length = self.coil_ratio * self.armature_radius
        inner = self.window[0]
        return wind(self.turns, wire.overall, wire.copper, length, inner, temperature=temperature)

    def armature_mass(self) -> float:
        """Return the mass of the armature [kg]."""
        rod = self.rod_ratio * self.armature_radius
        ring = math.pi * (self.armature_radius**2 - rod**2)
        return _DENSITY * ring * self.armature_ratio * self.armature_radius

    def moving_mass(self) -> float:
        """Return the mass of all that moves [kg]."""
        return self.armature_mass() + self.spool_mass

    def violations(self) -> tuple[Violation, ...]:
        """Return every restriction that is broken, with the amount; none = feasible.

        Raises
        ------
        ValueError
            If the standard has no such wire.
        """
        known = {d.name: d for d in describe(self)}
        own = [known[f.name] for f in fields(self) if f.name in known]
        checks = [Violation(d.name, float(getattr(self, d.name)), d.lower, d.upper, d.unit)
                  for d in own]  # fmt: skip
        found = [v for v in checks if not v.lower <= v.value <= v.upper]
        if found:
            return tuple(found)  # the rest follows from these
        overall, length = self.standard_wire().overall, self.coil_ratio * self.armature_radius
        if not self.wire <= overall <= length:
            return (Violation("overall diameter of the wire", overall, self.wire, length, "m"),)
        height, far = self.winding().height, math.inf
        depth = self.window_ratio * self.armature_radius
        checks = [
            Violation("winding height", height, 0.0, depth, "m"),
            Violation("stroke_ratio", self.stroke_ratio, 0.0, _MOST_STROKE, "1"),
            Violation("collar_ratio", self.collar_ratio, self.ring_ratio, far, "1"),
            Violation("bridge length", self.rim_tip - self.collar, 0.1 * self.gap, far, "m"),
            Violation("flange behind the pole's face", self.flange - self.face, 0.0, far, "m"),
        ]
        return tuple(v for v in checks if not v.lower <= v.value <= v.upper)

    def section(self) -> Section:
        """Return the half section that the field is computed of.

        Raises
        ------
        ValueError
            If a restriction is broken; names all of them.
        """
        broken = self.violations()
        if broken:
            raise ValueError("; ".join(str(v) for v in broken))
        radius, half = self.armature_radius, 0.5 * self.armature_ratio * self.armature_radius
        yoke = self.window[1] + self.former_ratio * radius
        outer, end = yoke + self.yoke_ratio * radius, self.flange + self.flange_ratio * radius
        tube, inside = self.tube, self.window[0]
        coil = rectangle(inside, inside + self.winding().height, *self.coil_ends)
        flange = rectangle(tube[1], yoke, self.flange, end)
        pole = self._pole(end)
        regions = (
            Region("armature", "steel", rectangle(self.rod_ratio * radius, radius, -half, half)),
            Region("collar", "steel", rectangle(*tube, -self.collar, self.collar)),
            Region("ring", "steel", rectangle(tube[1], yoke, -self.ring, self.ring)),
            Region("yoke", "steel", rectangle(yoke, outer, -end, end)),
            Region("pole_a", "steel", pole),
            Region("pole_b", "steel", mirrored(pole)),
            Region("flange_a", "steel", flange),
            Region("flange_b", "steel", mirrored(flange)),
            Region("coil_a", "air", coil, "A", float(self.turns)),
            Region("coil_b", "air", mirrored(coil), "B", -float(self.turns)),
        )
        motion = Motion(radius, tube[0], -half, half, -self.face, self.face, self.stroke)
        box = _BOX * outer, _BOX * end
        return Section("double stroke", regions, {"steel": self.steel}, motion, box[0], -box[1],
                       box[1])  # fmt: skip

    def _pole(self, end: float) -> Outline:
        """Return the corners of pole A: its rim is a cone outside."""
        rod, (inner, outer) = self.rod_ratio * self.armature_radius, self.tube
        tip = inner + self.tip_ratio * (outer - inner)
        face = self.face
        return ((rod, face), (inner, face), (inner, self.rim_tip), (tip, self.rim_tip),
                (outer, face), (outer, end), (rod, end))  # fmt: skip
