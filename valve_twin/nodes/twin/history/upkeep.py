# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Condense the old cycles of a twin's histories and read long ones, once a day beside the twin.

It is done in a process of its own that ends with the work, and the twin stores meanwhile: a part
is computed and takes the place of its cycles in one transaction. What fails is told and tried
again the next day; nothing is lost by it. What is read of a long history is kept beside it
(`io.history.aging`), so that `fleet` and the pages never begin with years of cycles.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from valve_twin.io.errors import ConfigError, StoreError
from valve_twin.io.history.aging import WORTH
from valve_twin.io.history.store import History
from valve_twin.io.history.tiers.extent import condensed, condensed_until, told
from valve_twin.io.history.tiers.retention import Retention
from valve_twin.nodes.runtime.node import STEADY
from valve_twin.nodes.runtime.worker import LAST, WorkerProcess

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.aging.config import AgingConfig
    from valve_twin.io.config.node_parameters import TwinParameters
    from valve_twin.nodes.runtime.node import ValveNode
    from valve_twin.nodes.runtime.worker import Outcome
    from valve_twin.nodes.twin.live_valve import LiveValve

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


@dataclass(frozen=True, slots=True)
class Upkeep:
    """What is done for the valves of one history.

    Attributes
    ----------
    history_url : str
        Where their cycles are.
    valves : tuple of str
        Their names.
    aging : tuple of AgingConfig or None
        Rules of aging of each whose history is long; None = it is read quickly.
    rule : Retention or None
        What is kept of every cycle; None = all of it.
    busy_timeout_s : float
        How long another program's lock of the database is waited for [s].
    """

    history_url: str
    valves: tuple[str, ...]
    aging: tuple[AgingConfig | None, ...]
    rule: Retention | None
    busy_timeout_s: float


def keep_up(work: Upkeep) -> list[str]:
    """Condense what need not be kept, then read what is long; in a process of its own.

    Parameters
    ----------
    work : Upkeep
        Of one history; its writers may go on.

    Returns
    -------
    list of str
        A line for each valve of which cycles were condensed, or of which something failed.
    """
    # what follows a valve over years is for this process alone: the twin starts without it
    from valve_twin.io.history.fleet import describe_valve
    from valve_twin.io.history.tiers.condense import condense

    lines = []
    with History(work.history_url, busy_timeout_s=work.busy_timeout_s) as history:
        for valve, aging in zip(work.valves, work.aging, strict=True):
            try:
                if work.rule is not None:
                    before = condensed_until(history, valve)
                    condense(history, valve, work.rule)
                    now = condensed(history, valve)
                    if now is not None and now.cycle > before:
                        lines.append(f"{valve}: {told(now)}")
                if aging is not None:
                    describe_valve(history, valve, aging)
            except StoreError as err:
                lines.append(f"{valve}: its history is not kept up: {err}")
    return lines


def keep_up_behind(work: Upkeep) -> list[str]:
    """Do `keep_up` when nothing else wants the processor; for a process that ends then."""
    os.nice(LAST)
    return keep_up(work)


class HistoryKeeper:
    """Keeps up the histories of a twin node.

    Parameters
    ----------
    node : ValveNode
        The twin node.
    valves : sequence of LiveValve
        Its valves.
    rule : Retention or None
        What is kept of every cycle; None = all of it.
    busy_timeout_s : float
        How long another program's lock of a database is waited for [s].
    """

    def __init__(
        self,
        node: ValveNode,
        valves: Sequence[LiveValve],
        rule: Retention | None,
        busy_timeout_s: float,
    ) -> None:
        self._node, self._valves, self._rule = node, valves, rule
        self._busy_timeout_s = busy_timeout_s
        self._worker: WorkerProcess | None = None
        self._left, self._closed = 0, False
        self._timer: Any = None
        self._put_off(FIRST_S)

    def close(self) -> None:
        """End it now; what is being condensed stays as it is."""
        self._closed = True
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
        self._end_worker()

    def _put_off(self, pause_s: float) -> None:
        self._timer = self._node.create_timer(pause_s, self._begin, clock=STEADY)

    def _begin(self) -> None:
        self._node.destroy_timer(self._timer)
        self._timer = None
        works = self._works()
        if not works:
            self._put_off(EVERY_S)
            return
        self._worker, self._left = WorkerProcess(), len(works)
        for work in works:
            self._worker.submit(
                keep_up_behind, (work,), lambda done: self._node.post(partial(self._take, done))
            )

    def _works(self) -> list[Upkeep]:
        """Return what there is to do; a young history needs nothing, and no process for it."""
        works = []
        for url in dict.fromkeys(v.config.history_url for v in self._valves):
            own = [v for v in self._valves if v.config.history_url == url]
            aging = tuple(v.config.aging if v.last_cycle >= WORTH else None for v in own)
            if self._rule is not None or any(a is not None for a in aging):
                names = tuple(v.name for v in own)
                works.append(Upkeep(url, names, aging, self._rule, self._busy_timeout_s))
        return works

    def _take(self, outcome: Outcome) -> None:
        """Tell what came of one history; the process ends with the last."""
        if self._closed:
            return
        logger = self._node.get_logger()
        if outcome.error:
            logger.warning(f"a history is not kept up: {outcome.error}")
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
