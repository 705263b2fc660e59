# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A valve that switches at a fixed instant of every cycle, seen in the flow: lag and leakage."""

from valve_twin.core.valves.cycle_timing.model import MODEL

__all__ = ["MODEL"]
