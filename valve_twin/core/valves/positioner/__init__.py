# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A valve or cylinder that follows a position command: delay, dead band, rates, slew limits."""

from valve_twin.core.valves.positioner.model import MODEL

__all__ = ["MODEL"]
