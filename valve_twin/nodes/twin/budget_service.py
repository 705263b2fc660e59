# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The service that computes an error budget, in the worker process behind the estimations due."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.valves.error_budget import Budget
    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.nodes.runtime.services import Done
    from valve_twin.nodes.runtime.worker import Outcome
    from valve_twin.nodes.twin.live_valve import LiveValve

MOST_REALISATIONS, MOST_SETTINGS, MOST_OF_A_SETTING = 64, 64, 200
"""What one request may ask for: the estimations that come meanwhile wait for it."""


def compute_budget(
    config: ValveConfig,
    sizes: tuple[float, float],
    realisations: int,
    settings: tuple[str, ...],
) -> Budget:
    """Compute the budget of a valve; runs in the worker process.

    Parameters
    ----------
    config : ValveConfig
        The valve.
    sizes : (float, float)
        Offset and noise of the commands, 0 = default [1].
    realisations : int
        Draws of every noise, 0 = default.
    settings : tuple of str
        Further settings of the simulation as NAME=VALUE.

    Raises
    ------
    ConfigError
        If a setting or a size cannot be used.
    """
    # a twin that is not asked needs neither the simulation nor the writing of bags
    from valve_twin.io.offline.budget import configured_budget

    given = {"offset": sizes[0], "command_noise": sizes[1], "realisations": realisations}
    wanted = {name: size for name, size in given.items() if size}
    return configured_budget(config, wanted, overrides=settings)


def begin_budget(valve: LiveValve, request: Any, response: Any, done: Done) -> None:
    """Hand the budget to the worker.

    Parameters
    ----------
    valve : LiveValve
        The valve; the budget waits behind its estimations.
    request : valve_twin_msgs/srv/GetErrorBudget.Request
        Offset and noise of the commands and draws of every noise [1], 0 = default; further
        settings as NAME=VALUE.
    response : valve_twin_msgs/srv/GetErrorBudget.Response
        Empty; filled when the budget is there.
    done : callable
        Gets the response, filled or with the reason why there is no budget.
    """
    wrong = _too_much(int(request.realisations), request.settings)
    if wrong:
        response.success, response.message = False, f"{valve.name}: no error budget: {wrong}"
        done(response)
        return
    sizes = (float(request.offset), float(request.command_noise))
    arguments = (valve.config, sizes, int(request.realisations), tuple(request.settings))
    valve.jobs.run(compute_budget, arguments, partial(_answer, valve.name, response, done))


def _too_much(realisations: int, settings: Sequence[str]) -> str:
    """Return what of a request would hold up the estimations, empty where nothing does."""
    if realisations > MOST_REALISATIONS:
        return f"realisations = {realisations}: {MOST_REALISATIONS} at most"
    if len(settings) > MOST_SETTINGS or any(len(s) > MOST_OF_A_SETTING for s in settings):
        return f"settings: {MOST_SETTINGS} at most, of {MOST_OF_A_SETTING} characters"
    if any(s.partition("=")[0].strip() == "period_s" for s in settings):
        return "settings: period_s is that of the valve and is not set here"
    return ""


def _answer(valve: str, response: Any, done: Done, outcome: Outcome) -> None:
    budget: Budget | None = None if outcome.error else outcome.result
    if budget is None or not budget.columns:
        reason = outcome.error if budget is None else budget.reason
        response.success, response.message = False, f"{valve}: no error budget: {reason}"
    else:
        fill(response, budget)
        response.success = True
        response.message = f"{valve}: {len(budget.rows)} sources, {outcome.wall_s:.1f} s"
    done(response)


def fill(response: Any, budget: Budget) -> None:
    """Write a budget into a response."""
    columns = range(len(budget.columns))
    response.parameters = [c.parameter for c in budget.columns]
    response.estimators = [c.estimator for c in budget.columns]
    response.values = [c.value for c in budget.columns]
    response.rows = [row.letter for row in budget.rows]
    response.sources = [row.text for row in budget.rows]
    response.sizes = [row.size for row in budget.rows]
    response.errors = [error for row in budget.rows for error in row.errors]
    response.totals = [budget.total(k) for k in columns]
    response.root_sum_squares = [budget.root_sum_square(k) for k in columns]
