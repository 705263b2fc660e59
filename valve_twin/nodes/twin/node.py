# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The twin node: hosts the twins of one or many valves; it never publishes a command."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from rclpy.clock import JumpThreshold, TimeJump
from rclpy.duration import Duration

from valve_twin.compat.interpreter import share_interpreter
from valve_twin.io.config.node_parameters import TwinParameters
from valve_twin.io.errors import ConfigError
from valve_twin.io.history.spool import MemoryBudget
from valve_twin.io.history.store import History
from valve_twin.io.history.unsaved import unsaved_of
from valve_twin.io.instruments.derived import is_made
from valve_twin.nodes.runtime.diagnostics import ERROR, STALE, Diagnostics, Report
from valve_twin.nodes.runtime.memory_trim import MemoryTrimmer
from valve_twin.nodes.runtime.node import SPIN_S, STEADY, ValveNode
from valve_twin.nodes.runtime.parameters import OF_VALVES
from valve_twin.nodes.runtime.second_reader import LOOK_S
from valve_twin.nodes.runtime.worker import WorkerProcess
from valve_twin.nodes.twin.budget_service import BudgetDesk
from valve_twin.nodes.twin.estimation_job import warm_up, warm_up_prediction
from valve_twin.nodes.twin.faults import TwinFaults
from valve_twin.nodes.twin.history.upkeep import HistoryKeeper, retention_of
from valve_twin.nodes.twin.history.writer import HistoryWriter
from valve_twin.nodes.twin.inputs import InputConfig, by_topic, seconds_now
from valve_twin.nodes.twin.live_valve import LiveValve
from valve_twin.nodes.twin.services import TwinServices
from valve_twin.nodes.twin.valve_parameters import read_valves

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from valve_twin.io.config.valve import ValveConfig

FLUSH_S = 1.0
"""Time that is given to the database at the end [s]."""

KEPT_B_S = 4e7
"""So much of the memory of waiting cycles a disk keeps at the end [B/s], assumed: a quarter of
what one with other work did, 400 MB in 2.6 s."""

SAVE_S = 1.0
"""How often the state of a valve is saved for a restart [s]."""

MOST_OFTEN_S = 0.05
"""Shortest time between two such states in one node, in the mean [s]."""

WAKE_S = 0.1
"""A node of many valves is woken so often for it: a wake costs as much as a state [s]."""

_BACKWARD_JUMP_S = 0.1


class TwinNode(ValveNode):
    """Lifecycle node of the twins."""

    works_in_callbacks = True

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("twin", **kwargs)
        self._valves: list[LiveValve] = []
        self._awake: set[LiveValve] = set()
        self._valve_services: list[TwinServices] = []
        self._history_writers: dict[str, HistoryWriter] = {}
        self._worker: WorkerProcess | None = None
        self._budgets = BudgetDesk(self)
        self._keeper: HistoryKeeper | None = None
        self._diagnostics: Diagnostics | None = None
        self._jump: Any = None
        self._listening: Any = None
        self._faults: dict[str, TwinFaults] = {}
        self._restarts = 0
        self._left_out: dict[str, str] = {}
        self._turn, self._at_once = 0, 1
        self._save_timer: Any = None
        self._memory_trimmer = MemoryTrimmer(0)

    def configure(self) -> None:
        """Open the histories and make the twins with what they had learnt."""
        self._left_out = {}
        share_interpreter()
        self._check_given()
        configs = read_valves(self, self._left_out)
        signals = {c.name: by_topic(self, c.signals.values()) for c in configs}
        given = self.parameters.read(TwinParameters)
        rule = retention_of(given)
        for url in dict.fromkeys(c.history_url for c in configs):
            history = History(
                url, busy_timeout_s=given.busy_timeout_s, events_kept=given.events_kept
            )
            self._history_writers[url] = HistoryWriter(
                self,
                history,
                retry_s=given.retry_s,
                limit=given.unsaved_limit,
                unsaved=unsaved_of(history, given.state_folder),
            )
        kinds = [(c.model, c.cycles.rule, c.options) for c in configs]
        kinds = [kind for i, kind in enumerate(kinds) if kind not in kinds[:i]]
        self._worker = WorkerProcess(partial(warm_up, kinds))
        compiled = warm_up_prediction(kinds)
        if compiled.kernels:
            self.get_logger().info(f"prediction: {compiled}")
        budget = MemoryBudget(round(1e6 * given.memory_budget_mb))
        for config in configs:
            self._tell_made(config)
            valve = LiveValve(
                self,
                config,
                signals[config.name],
                history_writer=self._history_writers[config.history_url],
                worker=self._worker,
                awake=self._awake,
                budget=budget,
            )
            self._valves.append(valve)
            self._valve_services.append(TwinServices(self, valve, self._budgets))
            self._faults[valve.name] = TwinFaults(self.faults, valve)
            self.get_logger().info(
                f"{valve.name}: {config.model}, cycles go on from {valve.last_cycle}, "
                f"history {valve.history.where}"
            )
        self._keeper = HistoryKeeper(self, self._valves, rule, given.busy_timeout_s)
        self._memory_trimmer = MemoryTrimmer(len(self._valves))
        self._diagnostics = Diagnostics(self, self._reports)
        each_s = max(SAVE_S / max(len(self._valves), 1), MOST_OFTEN_S)
        self._at_once = max(round(WAKE_S / each_s), 1)
        self._save_timer = self.create_timer(each_s * self._at_once, self._save_next, clock=STEADY)

    def _tell_made(self, config: ValveConfig) -> None:
        """Say that channels made from others are made by the import only."""
        for source in config.signals.values():
            if is_made(source.column):
                self.get_logger().warning(
                    f"{config.name}: signals.{source.signal}.column '{source.column}' is made by "
                    "`valve-twin import` and not by a live twin, which takes "
                    f"'{source.topic}' as it is: publish '{source.column}' there"
                )

    def _check_given(self) -> None:
        """Refuse to make a database for a valve that nobody described."""
        given = {**self.parameters.overrides, **self.parameters.given()}
        if not any(name.startswith(OF_VALVES) for name in given):
            msg = (
                f"{self.get_fully_qualified_name()}: no valve is described: give --params-file "
                "FILE as in config/, or -p model:=NAME to take the defaults of a model"
            )
            raise ConfigError(msg)

    def activate(self) -> None:
        """Listen to the signals."""
        given = self.parameters.read(TwinParameters)
        config = InputConfig(given.input_queue, given.deadline_s, given.silence_s)
        threshold = JumpThreshold(
            min_forward=None,
            min_backward=Duration(nanoseconds=-round(_BACKWARD_JUMP_S * 1e9)),
            on_clock_change=False,
        )
        self._jump = self.get_clock().create_jump_callback(threshold, post_callback=self._on_jump)
        for valve in self._valves:
            valve.listen(config)
        self._listening = self.create_timer(LOOK_S, self._look_at_inputs, clock=STEADY)
        if self._worker is not None:
            self._worker.begin()

    def deactivate(self) -> None:
        """Stop listening."""
        if self._jump is not None:
            self._jump.unregister()
            self._jump = None
        if self._listening is not None:
            self.destroy_timer(self._listening)
            self._listening = None
        for valve in self._valves:
            valve.silence()

    def cleanup(self) -> None:
        """Write what waits, then let go of everything."""
        if self._keeper is not None:
            self._keeper.close()
        end_s = seconds_now() + FLUSH_S
        writers = self._history_writers.values()
        unsaved = 0
        for writer in writers:
            left_s = max(end_s - seconds_now(), 0.05)
            own = [v for v in self._valves if v.cycle_queue.writer is writer]
            held = sum(v.spool.held for v in own)
            unsaved += writer.close(
                left_s,
                partial(_each, LiveValve.save_last, own),
                partial(_each, LiveValve.flush, own),
                save_s=held / KEPT_B_S,
            )
        if self._save_timer is not None:
            self.destroy_timer(self._save_timer)
        if unsaved:
            self.get_logger().error(
                f"the database did not take all cycles in time; {unsaved} unsaved ones are lost"
            )
        if self._worker is not None:
            self._worker.close()
        self._budgets.close()
        for service in self._valve_services:
            service.destroy()
        for valve in self._valves:
            valve.close()
        if self._diagnostics is not None:
            self._diagnostics.destroy()
        self._valves, self._valve_services, self._history_writers = [], [], {}
        self._awake.clear()
        self._worker = self._keeper = self._diagnostics = self._save_timer = None
        self._faults = {}

    def _save_next(self) -> None:
        """Save the state of a few valves, each in its turn."""
        for _ in range(min(self._at_once, len(self._valves))):
            self._turn = (self._turn + 1) % len(self._valves)
            self._valves[self._turn].save()

    def _look_at_inputs(self) -> None:
        now_s = seconds_now()
        for valve in self._valves:
            for topic in valve.inputs.topics:
                topic.look(now_s)

    def work(self) -> None:
        """Work on what the inputs gathered."""
        for valve in tuple(self._awake):
            valve.work()

    def due_s(self) -> float:
        """Return when the first valve wants to work [s]."""
        return min((v.due_s() for v in self._awake), default=SPIN_S)

    def _on_jump(self, jump: TimeJump) -> None:
        if jump.delta.nanoseconds < 0:
            for valve in self._valves:
                valve.clock_jumped()

    def _reports(self) -> Iterable[Report]:
        self._look_at_node()
        waiting = sum(v.twin.pending_jobs for v in self._valves)
        late_s = max((v.worst_latency_s for v in self._valves), default=0.0)
        self._memory_trimmer.look(waiting, late_s, seconds_now())
        for name, why in self._left_out.items():
            yield Report(f"valve {name}", name, level=ERROR, message=why)
        for valve in self._valves:
            yield self._report(valve)

    def _look_at_node(self) -> None:
        """File what concerns all valves."""
        simulated = self.get_parameter("use_sim_time").value
        waiting = simulated and not self.get_clock().now().nanoseconds
        self.faults.look(
            "clock.waiting", "use_sim_time is set and no /clock has come yet" if waiting else ""
        )
        restarts = max(self._worker.restarts, 0) if self._worker is not None else 0
        if restarts > self._restarts:
            self.faults.report(
                "estimation.worker_died",
                f"the estimating process was started again, {restarts} times in all",
                events=restarts - self._restarts,
            )
        self._restarts = restarts

    def _report(self, valve: LiveValve) -> Report:
        self._faults[valve.name].look()
        worst_s, valve.worst_latency_s = valve.worst_latency_s, 0.0
        report = Report(f"valve {valve.name}", valve.name)
        report.figures = partial(self._figures, valve, worst_s)
        if valve.stopped:
            report.raise_to(ERROR, valve.stopped)
        if self.state != "active":
            report.raise_to(STALE, f"the node is {self.state}")
        return report

    def _figures(self, valve: LiveValve, worst_s: float) -> dict[str, object]:
        figures: dict[str, object] = {
            "model": valve.config.model,
            "cycle": valve.twin.cycle or valve.last_cycle,
            "samples predicted": valve.publishers.predicted,
            "cycles estimated": valve.jobs.estimated,
            "cycles refused": valve.jobs.refused,
            "cycles stored": valve.cycle_queue.stored,
            "cycles unsaved": valve.cycle_queue.waiting,
            "cycles dropped unsaved": valve.cycle_queue.dropped,
            "cycles refused by the history": valve.cycle_queue.refused,
            "estimations pending": valve.twin.pending_jobs,
            "cycles waiting on disk": valve.spool.spooled,
            "cycles dropped before estimation": valve.spool.dropped,
            "waits cut off": valve.jobs.wait.cut,
            "last estimation [s]": f"{valve.jobs.wall_s:.3f}",
            "worst latency [ms]": f"{1e3 * worst_s:.2f}",
            "worker restarts": max(self._worker.restarts, 0) if self._worker is not None else 0,
        }
        counts = valve.twin.counts()
        for topic in valve.inputs.topics:
            figures[f"{topic.topic} received/lost/unreadable"] = (
                f"{topic.received}/{topic.lost}/{topic.broken}"
            )
            figures[f"{topic.topic} listened anew"] = topic.deaf
        for offset in self._faults[valve.name].offsets:
            key = f"clock of {offset.signal} ahead of {offset.output} [s]"
            figures[key] = f"{offset.offset_s:.3f}"
        for name, count in counts.items():
            figures[f"{name} late/duplicate/bad"] = f"{count.late}/{count.duplicate}/{count.bad}"
        return figures


def _each(do: Callable[[LiveValve], None], valves: Iterable[LiveValve]) -> None:
    for valve in valves:
        do(valve)
