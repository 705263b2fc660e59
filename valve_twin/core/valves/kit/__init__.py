# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What valves share: a law and a list of parameters become a model and a plant.

A new valve is one file: a compiled `step`, its `parameter`s and a program of commands; see
`core/valves/first_order.py` and docs/developers/add_a_valve.md.
"""

from valve_twin.core.valves.kit.law import Law, Lawful, LawParameter, parameter
from valve_twin.core.valves.kit.plant import Program, steps
from valve_twin.core.valves.kit.valve import Valve

__all__ = ["Law", "LawParameter", "Lawful", "Program", "Valve", "parameter", "steps"]
