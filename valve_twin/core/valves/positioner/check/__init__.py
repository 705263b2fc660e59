# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Whether the structure that a positioner's options say is the valve's."""

from valve_twin.core.valves.positioner.check.doubt import doubted
from valve_twin.core.valves.positioner.check.rivals import rivals_of

__all__ = ["doubted", "rivals_of"]
