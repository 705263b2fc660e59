# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The error budget of a configured valve."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from valve_twin.core.valves.error_budget import Budget, BudgetOptions, error_budget
from valve_twin.core.valves.registry import get_model
from valve_twin.io.errors import ConfigError
from valve_twin.io.offline.simulated_bag import simulation_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from valve_twin.io.config.valve import ValveConfig


def configured_budget(
    config: ValveConfig,
    sizes: Mapping[str, Any] | None = None,
    *,
    overrides: Sequence[str] = (),
    advance: Callable[[], None] = lambda: None,
) -> Budget:
    """Compute the error budget of the valve that a configuration describes.

    Parameters
    ----------
    config : ValveConfig
        Its `simulation` section is the valve, its `options` are those of the estimators.
    sizes : mapping, optional
        Fields of `BudgetOptions`: sizes of the sources that the simulation does not state.
    overrides : sequence of str
        More settings of the simulation as NAME=VALUE.
    advance : callable
        Called once a row.

    Raises
    ------
    ConfigError
        If a setting or a size cannot be used.
    """
    simulation = simulation_of(config, overrides)
    try:
        options = replace(BudgetOptions(), **(sizes or {}))
    except ValueError as err:
        msg = f"budget: {err}"
        raise ConfigError(msg) from err
    return error_budget(get_model(config.model), config.options, simulation, options, advance)
