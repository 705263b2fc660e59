# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The estimations of one valve: a closed cycle becomes a job of the worker, its result comes back.

One at a time and in order; the data path does not wait for them, but see `estimate_wait`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from valve_twin.core.types import Estimate, EstimateStatus
from valve_twin.nodes.twin.estimate_wait import EstimateWait, longest_wait_s
from valve_twin.nodes.twin.estimation_job import MEMORY_LACKS, run_job

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.estimation.cycle.memory import Memory
    from valve_twin.core.twin import Job, Twin
    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.nodes.runtime.node import ValveNode
    from valve_twin.nodes.runtime.worker import Outcome, Work, WorkerProcess


class Jobs:
    """Runs the jobs of one twin.

    Parameters
    ----------
    node : ValveNode
        The twin node.
    config : ValveConfig
        The valve.
    worker : WorkerProcess
        Runs the estimations.
    deliver : callable
        Gets the estimates of a job, the memory after them and the computing time [s].

    Attributes
    ----------
    wait : EstimateWait
        How long predictions wait for a result.
    estimated, refused, failed : int
        Cycles that were estimated, that gave nothing for the trend, that ended with an error [1].
    failure : str
        The last error.
    wall_s : float
        Computing time of the last estimation [s].
    renewed : list of int
        First cycles of new references, by maintenance [1].
    """

    def __init__(
        self,
        node: ValveNode,
        config: ValveConfig,
        *,
        worker: WorkerProcess,
        deliver: Callable[[tuple[Estimate, ...], Memory, float], None],
    ) -> None:
        self._node, self._config, self._worker = node, config, worker
        self._deliver_to = deliver
        self._job: Job | None = None
        self._ordinal = 0
        topics = (source.topic for source in config.signals.values())
        self.wait = EstimateWait(longest_wait_s(node, topics))
        self.estimated = self.refused = self.failed = 0
        self.failure, self.wall_s = "", 0.0
        self.renewed: list[int] = []

    def start(self, twin: Twin) -> None:
        """Begin the next job where none runs."""
        if self._job is not None:
            return
        self._job = twin.next_job()
        if self._job is not None:
            self._ordinal += 1
            self._submit(None)

    def run(
        self, work: Work, arguments: tuple[Any, ...], deliver: Callable[[Outcome], None]
    ) -> None:
        """Run a module-level function behind the estimations due.

        Parameters
        ----------
        work : callable
            What runs in the worker.
        arguments : tuple
            Its arguments.
        deliver : callable
            Gets the outcome on the node's loop.
        """
        post = self._node.post
        self._worker.submit(work, arguments, lambda done: post(partial(deliver, done)))

    def _submit(self, memory: Memory | None) -> None:
        assert self._job is not None
        config, cycle = self._config, self._job.cycle
        since = max((n for n in self.renewed if n <= cycle.number), default=0)
        cycle = replace(cycle, since=since)
        arguments = config.name, config.model, config.options, cycle, self._ordinal, memory
        self.run(run_job, arguments, self._deliver)

    def _deliver(self, outcome: Outcome) -> None:
        job = self._job
        if job is None:
            return
        if not outcome.error and outcome.result is MEMORY_LACKS:
            self._submit(job.memory)
            return
        self._job = None
        estimates: tuple[Estimate, ...] = () if outcome.error else outcome.result
        if outcome.error:
            self.failed += 1
            self.failure = f"cycle {job.cycle.number} is not estimated: {outcome.error}"
            self._node.get_logger().error(f"{self._config.name}: {self.failure}")
        self.estimated += 1
        self.wall_s = outcome.wall_s
        self._judge(job.cycle.number, estimates)
        memory = job.memory.after(estimates) if estimates else job.memory
        self._deliver_to(estimates, memory, outcome.wall_s)

    def _judge(self, number: int, estimates: tuple[Estimate, ...]) -> None:
        """Count a cycle that gave nothing for the trend; several in a row are a fault."""
        faults, code, valve = self._node.faults, "estimation.refused", self._config.name
        if any(e.used_by_trend for e in estimates if e.status is not EstimateStatus.REFUSED):
            faults.passed(code, valve=valve)
            return
        self.refused += 1
        reason = next((e.reason for e in estimates), self.failure)
        faults.report(code, f"cycle {number} gives no estimate: {reason}", valve=valve)
