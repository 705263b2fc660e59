# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A hydraulic servosystem with a suspension valve, after paper 003."""

from valve_twin.core.valves.servo_system.model import MODEL

__all__ = ["MODEL"]
