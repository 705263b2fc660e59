# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Geometry of a solenoid: descriptions, feasibility, winding, and files in and out."""

from valve_twin.design.geometry.double_stroke import DoubleStroke, Violation
from valve_twin.design.geometry.dxf import read_dxf, write_dxf
from valve_twin.design.geometry.files import read_design, write_design
from valve_twin.design.geometry.hybrid_pole import HybridPole
from valve_twin.design.geometry.picture import draw_section
from valve_twin.design.geometry.section import Motion, Region, Section
from valve_twin.design.geometry.wires import Wire, find_wire

__all__ = [
    "DoubleStroke",
    "HybridPole",
    "Motion",
    "Region",
    "Section",
    "Violation",
    "Wire",
    "draw_section",
    "find_wire",
    "read_design",
    "read_dxf",
    "write_design",
    "write_dxf",
]
