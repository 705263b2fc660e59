# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Parameters of the nodes beside those of the valve: one table a node, declared and documented from here."""

from __future__ import annotations

from valve_twin.io.schema import Kind, Spec

_COMMON = (Spec("autostart", Kind.BOOL, True, "Configure and activate by itself at start."),)

NODE_PARAMETERS: dict[str, tuple[Spec, ...]] = {
    "simulated_valve": _COMMON,
    "twin": _COMMON,
    "aging_monitor": _COMMON,
    "bag_player": _COMMON,
    "bag_recorder": _COMMON,
}
"""Parameters by node name."""
