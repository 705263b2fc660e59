# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The service that computes error budgets, one at a time, in a process beside the estimating one.

No estimation waits for it. The process is started for a budget and ends with it. It has a low
priority, so that an estimation beside it takes its processor; memory and time are bounded.
"""

from __future__ import annotations

import os
from functools import partial
from typing import TYPE_CHECKING, Any

from valve_twin.io.errors import ConfigError
from valve_twin.io.limits import bounded_memory
from valve_twin.nodes.runtime.node import STEADY
from valve_twin.nodes.runtime.worker import LAST, Outcome, WorkerProcess

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.valves.error_budget import Budget
    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.nodes.runtime.node import ValveNode
    from valve_twin.nodes.runtime.services import Done
    from valve_twin.nodes.twin.live_valve import LiveValve

MOST_REALISATIONS, MOST_SETTINGS, MOST_OF_A_SETTING = 64, 64, 200
"""What one request may ask for."""

MOST_S = 300.0
"""Longest time that a budget gets [s]: others are refused meanwhile. One of 64 realisations took
17 s beside four other programs on two cores."""

MOST_B = 256_000_000
"""Memory that it gets beyond that of the imports [B]: 64 realisations of 850 samples take 5 MB."""


def compute_budget(
    config: ValveConfig,
    sizes: tuple[float, float],
    realisations: int,
    settings: tuple[str, ...],
) -> Budget:
    """Compute the budget of a valve; for a process that ends then.

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

    os.nice(LAST)
    given = {"offset": sizes[0], "command_noise": sizes[1], "realisations": realisations}
    wanted = {name: size for name, size in given.items() if size}
    try:
        with bounded_memory(MOST_B):
            return configured_budget(config, wanted, overrides=settings)
    except MemoryError as err:
        msg = "it takes more memory than a budget gets; give settings of a shorter cycle"
        raise ConfigError(msg) from err


class BudgetDesk:
    """Takes the requests of all valves of a node, one at a time.

    Parameters
    ----------
    node : ValveNode
        The twin node.
    """

    def __init__(self, node: ValveNode) -> None:
        self._node = node
        self._worker: WorkerProcess | None = None
        self._timer: Any = None
        self._valve = ""

    def begin(self, valve: LiveValve, request: Any, response: Any, done: Done) -> None:
        """Have a budget computed, or refuse it.

        Parameters
        ----------
        valve : LiveValve
            The valve.
        request : valve_twin_msgs/srv/GetErrorBudget.Request
            Offset and noise of the commands and draws of every noise [1], 0 = default; further
            settings as NAME=VALUE.
        response : valve_twin_msgs/srv/GetErrorBudget.Response
            Empty; filled when the budget is there.
        done : callable
            Gets the response, filled or with the reason why there is no budget.
        """
        wrong = _too_much(int(request.realisations), request.settings) or self._busy()
        if wrong:
            response.success, response.message = False, f"{valve.name}: no error budget: {wrong}"
            done(response)
            return
        sizes = (float(request.offset), float(request.command_noise))
        arguments = (valve.config, sizes, int(request.realisations), tuple(request.settings))
        self._valve, worker = valve.name, WorkerProcess()
        answer = partial(self._answer, worker, response, done)
        post, late = self._node.post, Outcome(None, _LATE.format(MOST_S), MOST_S)
        self._worker = worker
        self._timer = self._node.create_timer(MOST_S, partial(answer, late), clock=STEADY)
        worker.submit(compute_budget, arguments, lambda outcome: post(partial(answer, outcome)))

    def close(self) -> None:
        """End what is being computed; its caller gets no answer."""
        if self._worker is not None:
            self._worker.close()
            self._node.destroy_timer(self._timer)
        self._worker = self._timer = None

    def _busy(self) -> str:
        if self._worker is None:
            return ""
        return f"that of {self._valve} is being computed; ask again when it is answered"

    def _answer(self, worker: WorkerProcess, response: Any, done: Done, outcome: Outcome) -> None:
        """Answer once; of time and result, which may come together, the first one counts."""
        if self._worker is not worker:
            return
        valve = self._valve
        self.close()
        budget: Budget | None = None if outcome.error else outcome.result
        if budget is None or not budget.columns:
            reason = outcome.error if budget is None else budget.reason
            response.success, response.message = False, f"{valve}: no error budget: {reason}"
        else:
            fill(response, budget)
            response.success = True
            response.message = f"{valve}: {len(budget.rows)} sources, {outcome.wall_s:.1f} s"
        done(response)


_LATE = "it is not done within {:g} s; ask for fewer realisations"


def _too_much(realisations: int, settings: Sequence[str]) -> str:
    """Return what of a request is too much, empty where nothing is."""
    if realisations > MOST_REALISATIONS:
        return f"realisations = {realisations}: {MOST_REALISATIONS} at most"
    if len(settings) > MOST_SETTINGS or any(len(s) > MOST_OF_A_SETTING for s in settings):
        return f"settings: {MOST_SETTINGS} at most, of {MOST_OF_A_SETTING} characters"
    for name in (s.partition("=")[0].strip() for s in settings):
        if name == "period_s" or name.partition(".")[0] == "fmu":
            return f"settings: {name} is that of the valve and is not set here"
    return ""


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
