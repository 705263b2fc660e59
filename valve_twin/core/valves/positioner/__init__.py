# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Any valve or cylinder that follows a position command: delay, dead band, rate and slew limit by direction."""

from valve_twin.core.valves.positioner.model import MODEL

__all__ = ["MODEL"]
