# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What `ros2 run valve_twin NAME` starts."""

from __future__ import annotations

from importlib import import_module

from valve_twin.nodes import signals


def twin() -> int:
    """Run the twin of one or more valves."""
    return _run("twin", "TwinNode")


def simulated_valve() -> int:
    """Run a simulated valve in place of the hardware."""
    return _run("simulated_valve", "SimulatedValveNode")


def aging_monitor() -> int:
    """Run the aging monitor of one or more valves."""
    return _run("aging_monitor", "AgingMonitorNode")


def bag_player() -> int:
    """Play a bag."""
    return _run("bag_player", "BagPlayerNode")


def bag_recorder() -> int:
    """Record topics to a bag."""
    return _run("bag_recorder", "BagRecorderNode")


def _run(module: str, node: str) -> int:
    signals.install()
    make = getattr(import_module(f"valve_twin.nodes.{module}"), node)
    run = import_module("valve_twin.nodes.runtime").run
    return int(run(make))
