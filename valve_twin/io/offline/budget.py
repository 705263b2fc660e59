# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The error budget of a configured valve."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.core.valves.error_budget import Budget, BudgetOptions, error_budget
from valve_twin.core.valves.registry import get_model
from valve_twin.io.errors import ConfigError
from valve_twin.io.offline.simulated_bag import simulation_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from valve_twin.io.config.valve import ValveConfig


def configured_budget(
    config: ValveConfig,
    options: BudgetOptions | None = None,
    *,
    overrides: Sequence[str] = (),
    advance: Callable[[], None] = lambda: None,
) -> Budget:
    """Compute the error budget of the valve that a configuration describes.

    Parameters
    ----------
    config : ValveConfig
        Its `simulation` section is the valve, its `options` are those of the estimators.
    options : BudgetOptions, optional
        Sizes of the sources that the simulation does not state.
    overrides : sequence of str
        More settings of the simulation as NAME=VALUE.
    advance : callable
        Called once a row.

    Raises
    ------
    ConfigError
        If a setting cannot be used.
    """
    model = get_model(config.model)
    simulation = simulation_of(config, overrides)
    chosen = config.options
    return error_budget(model, chosen, simulation, options or BudgetOptions(), advance)


def budget_options(
    *, offset: float, command_noise: float, realisations: int, seed: int
) -> BudgetOptions:
    """Return the options of a budget; a value that cannot be used is a ConfigError.

    Parameters
    ----------
    offset : float
        Offset of commands and position [1].
    command_noise : float
        Standard deviation of the logged commands [1].
    realisations : int
        Draws of every noise [1].
    seed : int
        Of all random numbers.
    """
    try:
        return BudgetOptions(offset, command_noise, realisations, seed)
    except ValueError as err:
        msg = f"budget: {err}"
        raise ConfigError(msg) from err
