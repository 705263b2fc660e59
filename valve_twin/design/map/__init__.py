# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Characteristic map of a solenoid: flux linkages and force from one coenergy spline."""

from valve_twin.design.map.compute import MapGrid, compute_map, map_of, unlike
from valve_twin.design.map.files import read_map, write_map
from valve_twin.design.map.sweep import Sweep, sweep_fields

__all__ = [
    "MapGrid",
    "Sweep",
    "compute_map",
    "map_of",
    "read_map",
    "sweep_fields",
    "unlike",
    "write_map",
]
