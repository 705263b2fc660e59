# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A valve that moves a heavy load through a cylinder: opening to load pressure."""

from valve_twin.core.valves.hydraulic_actuator.model import MODEL

__all__ = ["MODEL"]
