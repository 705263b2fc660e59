# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Hybrid electromechanical engine valve actuator: two solenoids, springs, permanent magnets."""

from valve_twin.core.valves.hybrid_actuator.model import MODEL

__all__ = ["MODEL"]
