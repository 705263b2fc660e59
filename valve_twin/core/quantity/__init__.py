# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""One descriptor of a parameter, declared where the parameter is: a field of a dataclass.

    @dataclass(frozen=True, slots=True)
    class Tank:
        volume: float = quantity(1.0, "m^3", "Volume.", lower=0.1, upper=5.0)
        lid: str = setting("open", "State of the lid.", choices=("open", "shut"))

`describe(Tank)` lists the descriptors; YAML keys and their checks, parameters of nodes, the
reference of parameters, limits, settings of a simulation and options of a model come from them.
"""

from valve_twin.core.quantity.declare import (
    Descriptor,
    Kind,
    assumed,
    compiled,
    example,
    needed,
    quantity,
    records,
    setting,
)
from valve_twin.core.quantity.names import listed, nearest, suggest
from valve_twin.core.quantity.tree import (
    QuantityError,
    check_quantities,
    checked,
    declared,
    describe,
    replaced,
)

__all__ = [
    "Descriptor",
    "Kind",
    "QuantityError",
    "assumed",
    "check_quantities",
    "checked",
    "compiled",
    "declared",
    "describe",
    "example",
    "listed",
    "nearest",
    "needed",
    "quantity",
    "records",
    "replaced",
    "setting",
    "suggest",
]
