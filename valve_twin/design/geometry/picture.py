# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The half section of a solenoid as a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.design.drawing import Sheet
from valve_twin.design.materials import Magnet, Steel

if TYPE_CHECKING:
    from valve_twin.design.geometry.section import Region, Section

_ROUND = (1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 1e-1)


def draw_section(section: Section) -> str:
    """Return the half section as an SVG document: the axis across, in millimetres."""
    corners = [corner for region in section.regions for corner in region.outline]
    low, high = min(z for _, z in corners), max(z for _, z in corners)
    sheet = Sheet(1.04 * max(r for r, _ in corners), low, high)
    for region in section.regions:
        sheet.polygon(region.outline, style_of(section, region))
    for region in section.regions:
        r = 0.5 * (min(r for r, _ in region.outline) + max(r for r, _ in region.outline))
        z = 0.5 * (min(z for _, z in region.outline) + max(z for _, z in region.outline))
        wide = max(z for _, z in region.outline) - min(z for _, z in region.outline)
        if wide > 0.006 * len(region.name) * (high - low):
            words = f"{region.name}: {region.turns:g} turns" if region.coil else region.name
            sheet.text(r, z, words)
    sheet.ruler(next((s for s in _ROUND if (high - low) / s < 16), _ROUND[-1]))
    sheet.note(f"{section.name}, z in mm; grey steel, brown winding, violet magnet")
    return sheet.finished(f"half section of {section.name}")


def style_of(section: Section, region: Region) -> str:
    """Return how a region is drawn."""
    if region.coil:
        return "coil"
    material = section.materials[region.material]
    if isinstance(material, Steel):
        return "steel"
    return "magnet" if isinstance(material, Magnet) else "other"
