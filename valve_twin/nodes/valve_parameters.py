# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The parameters of the valves that a node hosts, from the tables and the reader of files."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from valve_twin.core.valves.registry import get_model
from valve_twin.io.config import VALVE_SPECS, ValveConfig, parse_config, valve_specs

if TYPE_CHECKING:
    from collections.abc import Iterable

    from valve_twin.io.schema import Spec
    from valve_twin.nodes.runtime import ValveNode


def read_valves(node: ValveNode) -> list[ValveConfig]:
    """Declare the parameters of the node's valves and read them.

    Returns
    -------
    list of ValveConfig
        At least one.

    Raises
    ------
    ConfigError
        One line that names the node, the key, the value and what to do.
    """
    parameters = node.parameters
    parameters.declare(VALVE_SPECS)
    model = str(parameters["model"])
    parameters.declare(_specs(model))
    for valve in [v for v in parameters["valves"] if v]:
        own = str(parameters.overrides.get(f"{valve}.model", model))
        prefixed = (replace(s, name=f"{valve}.{s.name}") for s in _specs(own))
        parameters.declare(s for s in prefixed if s.name in parameters.overrides)
    parameters.warn_unknown(hosts_valves=True)
    parameters.check()
    given = parameters.given() | {
        name: value for name, value in parameters.overrides.items() if ".simulation." in f".{name}"
    }
    return parse_config(given, node.get_fully_qualified_name(), namespace=node.get_namespace())


def _specs(model: str) -> Iterable[Spec]:
    """Return the table of a model; of an unknown one what all share: the reader then names it."""
    try:
        return valve_specs(get_model(model))
    except ValueError:
        return VALVE_SPECS
