# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Condense the old cycles of a twin's histories once a day, in a process of its own.

The twin stores meanwhile: a part is computed beside it and takes the place of its cycles in one
transaction. What fails is told and tried again the next day; nothing is lost by it.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from valve_twin.io.errors import ConfigError, StoreError
from valve_twin.io.history.store import History
from valve_twin.io.history.tiers.condense import Retention, condense
from valve_twin.io.history.tiers.reading import condensed, condensed_until, told
from valve_twin.nodes.runtime.node import STEADY
from valve_twin.nodes.runtime.worker import WorkerProcess

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.io.config.node_parameters import TwinParameters
    from valve_twin.nodes.runtime.node import ValveNode
    from valve_twin.nodes.runtime.worker import Outcome

FIRST_S = 60.0
"""After a start, when there is other work, it is waited for so long [s]."""

EVERY_S = 86400.0
"""Whole days are condensed: once a day there is something to do [s]."""


def retention_of(given: TwinParameters) -> Retention | None:
    """Return what is kept of every cycle; None = all of it, for ever.

    Raises
    ------
    ConfigError
        If the parameters do not go together.
    """
    rule = Retention(given.keep_cycles, given.keep_days, given.keep_hours_for_days)
    if not (rule.cycles or rule.days):
        return None
    if wrong := rule.wrong():
        msg = f"{wrong}: correct keep_cycles, keep_days, keep_hours_for_days"
        raise ConfigError(msg)
    return rule


def condense_all(
    history_url: str, valves: Sequence[str], rule: Retention, busy_timeout_s: float
) -> list[str]:
    """Condense what need not be kept of some valves; in any process.

    Parameters
    ----------
    history_url : str
        Their history; its writers may go on.
    valves : sequence of str
        Their names.
    rule : Retention
        What is kept.
    busy_timeout_s : float
        How long another program's lock of the database is waited for [s].

    Returns
    -------
    list of str
        A line for each valve of which cycles were condensed, or could not be.
    """
    lines = []
    with History(history_url, busy_timeout_s=busy_timeout_s) as history:
        for valve in valves:
            try:
                before = condensed_until(history, valve)
                condense(history, valve, rule)
                now = condensed(history, valve)
            except StoreError as err:
                lines.append(f"{valve}: old cycles are not condensed: {err}")
                continue
            if now is not None and now.cycle > before:
                lines.append(f"{valve}: {told(now)}")
    return lines


class HistoryKeeper:
    """Condenses the histories of a twin node as its parameters say.

    Parameters
    ----------
    node : ValveNode
        The twin node.
    valves : mapping of str to sequence of str
        Names of the valves of each history, by its URL.
    rule : Retention or None
        What is kept; None = all, then nothing is ever done.
    busy_timeout_s : float
        How long another program's lock of a database is waited for [s].
    """

    def __init__(
        self,
        node: ValveNode,
        valves: Mapping[str, Sequence[str]],
        rule: Retention | None,
        busy_timeout_s: float,
    ) -> None:
        self._node, self._valves, self._rule = node, valves, rule
        self._busy_timeout_s = busy_timeout_s
        self._worker: WorkerProcess | None = None
        self._left = 0
        self._timer: Any = None
        if rule is not None:
            self._put_off(FIRST_S)

    def close(self) -> None:
        """End it now; what is being condensed stays as it is."""
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
        self._end_worker()
        self._rule = self._timer = None

    def _put_off(self, pause_s: float) -> None:
        self._timer = self._node.create_timer(pause_s, self._begin, clock=STEADY)

    def _begin(self) -> None:
        self._node.destroy_timer(self._timer)
        self._timer = None
        self._worker = WorkerProcess()
        self._left = len(self._valves)
        for url, names in self._valves.items():
            arguments = (url, tuple(names), self._rule, self._busy_timeout_s)
            self._worker.submit(
                condense_all, arguments, lambda done: self._node.post(partial(self._take, done))
            )

    def _take(self, outcome: Outcome) -> None:
        """Tell what came of one history; the process ends with the last."""
        if self._rule is None:
            return
        logger = self._node.get_logger()
        if outcome.error:
            logger.warning(f"old cycles are not condensed: {outcome.error}")
        for line in outcome.result or ():
            logger.info(line)
        self._left -= 1
        if not self._left:
            self._end_worker()
            self._put_off(EVERY_S)

    def _end_worker(self) -> None:
        if self._worker is not None:
            self._worker.close()
        self._worker = None
