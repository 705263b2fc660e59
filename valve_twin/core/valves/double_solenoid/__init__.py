# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Double-solenoid directional valve 4WRREH6: two coupled coils, a spool between two springs."""

from valve_twin.core.valves.double_solenoid.model import MODEL

__all__ = ["MODEL"]
