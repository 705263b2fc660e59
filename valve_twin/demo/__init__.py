# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The main job in minutes: a simulated valve ages, its twin follows; then a really measured valve.

`cases` says which valves there are: any model with a plant and a file in `config/`.
"""

from valve_twin.demo.processes import Processes

__all__ = ["Processes"]
