# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What one valve of the twin is asked and told: services, verdicts and events that it keeps."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from rclpy.qos import DurabilityPolicy, QoSProfile
from valve_twin_msgs import msg, srv

from valve_twin import __version__
from valve_twin.core.aging.verdict import LimitState, Trend, Verdict, VerdictKind
from valve_twin.core.operation.events import start_event
from valve_twin.core.quantity import suggest
from valve_twin.core.types import Maintenance
from valve_twin.core.valves.interface import estimator_choices
from valve_twin.core.valves.registry import get_model
from valve_twin.io.config.node_parameters import TwinParameters
from valve_twin.io.history.export import BackupRules
from valve_twin.io.history.log.events import LAST_ID, Acknowledgement
from valve_twin.io.history.remarks import wrong_note
from valve_twin.io.history.tiers.extent import condensed, condensed_until, told
from valve_twin.nodes.runtime import messages as convert
from valve_twin.nodes.runtime.services import DeferredService, Done
from valve_twin.nodes.twin.publishers import LATCHED

if TYPE_CHECKING:
    from valve_twin.nodes.runtime.node import ValveNode
    from valve_twin.nodes.runtime.worker import Outcome, WorkerThread
    from valve_twin.nodes.twin.budget_service import BudgetDesk
    from valve_twin.nodes.twin.live_valve import LiveValve

DEFAULT_PAGE, MOST_OF_A_PAGE = 1000, 10000
"""Estimates or entries of an answer, unless asked for another number, and at most [1]."""

EVENTS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Maintenance events: rare, and each of them counts."""


class TwinServices:
    """The services of one valve; what touches the database runs on the history's threads."""

    def __init__(self, node: ValveNode, valve: LiveValve, budgets: BudgetDesk) -> None:
        self._node, self._valve = node, valve
        base = f"{valve.name}/twin"
        self._estimate_now_service = node.create_service(
            srv.EstimateNow, f"{base}/estimate_now", self._estimate_now
        )
        self._maintenance = node.create_publisher(msg.Maintenance, f"{base}/maintenance", EVENTS)
        self._verdicts = VerdictLog(node, valve)
        self._limits = LimitLog(node, valve)
        self._events = EventServices(node, valve)
        self._deferred = [
            DeferredService(node, srv.MarkMaintenance, f"{base}/mark_maintenance", self._mark),
            DeferredService(
                node, srv.WithdrawMaintenance, f"{base}/withdraw_maintenance", self._withdraw
            ),
            DeferredService(node, srv.GetHistory, f"{base}/get_history", self._get_history),
            DeferredService(node, srv.BackupHistory, f"{base}/backup_history", self._backup),
            DeferredService(
                node, srv.GetErrorBudget, f"{base}/get_error_budget", partial(budgets.begin, valve)
            ),
        ]

    def destroy(self) -> None:
        """Take the services down."""
        self._node.destroy_service(self._estimate_now_service)
        self._node.destroy_publisher(self._maintenance)
        self._verdicts.destroy()
        self._limits.destroy()
        self._events.destroy()
        for service in self._deferred:
            service.destroy()

    def _estimate_now(self, request: Any, response: Any) -> Any:
        del request
        cycle = self._valve.close_cycle()
        response.success = cycle is not None
        response.cycle = cycle.number if cycle is not None else 0
        response.message = (
            f"cycle {cycle.number} closed: {cycle.reason}"
            if cycle is not None
            else f"{self._valve.name}: no cycle is running; wait for a command or look at the "
            "inputs"
        )
        return response

    def _mark(self, request: Any, response: Any, done: Done) -> None:
        valve = self._valve
        following = max(valve.twin.cycle, valve.last_cycle) + 1
        cycle = int(request.cycle) or following
        wrong = _wrong_mark(request.note, cycle, following)
        if wrong:
            response.success, response.message = False, f"{valve.name}: {wrong}"
            done(response)
            return
        stamp_ns = valve.last_stamp_ns or self._node.get_clock().now().nanoseconds
        event = Maintenance(stamp_ns, cycle, request.note, bool(request.new_reference))
        response.cycle = cycle

        def answer(outcome: Outcome) -> None:
            if not outcome.error:
                valve.note(event)
                self._maintenance.publish(convert.to_message(event))
            response.success = not outcome.error
            response.message = (
                outcome.error or f"{valve.name}: maintenance noted from cycle {cycle} on"
            )
            done(response)

        work = partial(valve.history.add_maintenance, valve.name, event)
        self._in_background(valve.cycle_queue.writer.write_thread, work, answer)

    def _withdraw(self, request: Any, response: Any, done: Done) -> None:
        valve, cycle = self._valve, int(request.cycle)

        def answer(outcome: Outcome) -> None:
            if not outcome.error:
                valve.note(outcome.result)
                self._maintenance.publish(convert.to_message(outcome.result))
            response.success = not outcome.error
            told = outcome.error or f"the event at cycle {cycle} is withdrawn: it begins nothing"
            response.message = f"{valve.name}: {told}"
            done(response)

        work = partial(valve.history.withdraw_maintenance, valve.name, cycle, request.note)
        self._in_background(valve.cycle_queue.writer.write_thread, work, answer)

    def _get_history(self, request: Any, response: Any, done: Done) -> None:
        valve, units = self._valve, self._valve.publishers.units
        estimator = request.estimator or valve.model.trend_estimator
        first = min(int(request.first_cycle), LAST_ID)
        limit = min(int(request.limit) or DEFAULT_PAGE, MOST_OF_A_PAGE)

        def read() -> Any:
            found = valve.history.estimates(valve.name, estimator, first, limit + 1)
            if not found and request.estimator:
                stored = {e.estimator for e in valve.history.recent_estimates(valve.name)}
                model = valve.model
                known = sorted(stored or {model.trend_estimator, *estimator_choices(model)})
                if estimator not in known:
                    response.message = f"no estimator {estimator!r}: {suggest(estimator, known)}"
            page = found[:limit]
            response.estimates = [
                convert.estimate_message(valve.name, e, units, stored=True) for e in page
            ]
            response.missed_cycles = [e.missed_cycles for e in page]
            events = valve.history.maintenance(valve.name)
            response.maintenance = [convert.to_message(e) for e in events]
            response.more = len(found) > limit
            if first <= condensed_until(valve.history, valve.name):
                old = condensed(valve.history, valve.name)
                response.message = response.message or (told(old) if old else "")
            response.success = True
            return response

        def answer(outcome: Outcome) -> None:
            if outcome.error:
                response.success, response.message = False, outcome.error
            done(response)

        self._in_background(valve.cycle_queue.writer.read_thread, read, answer)

    def _backup(self, request: Any, response: Any, done: Done) -> None:
        valve = self._valve

        def answer(outcome: Outcome) -> None:
            response.success = not outcome.error
            response.path = "" if outcome.error else str(outcome.result)
            response.message = outcome.error or f"history copied to {outcome.result}"
            done(response)

        given = self._node.parameters.read(TwinParameters)
        rules = BackupRules(given.backup_folder, given.backups_kept)
        work = partial(valve.history.backup_for, rules, request.path)
        self._in_background(valve.cycle_queue.writer.read_thread, work, answer)

    def _in_background(self, thread: WorkerThread, work: Any, answer: Any) -> None:
        post = self._node.post
        thread.submit(work, lambda outcome: post(partial(answer, outcome)))


def _wrong_mark(note: str, cycle: int, following: int) -> str:
    """Return what is wrong with a maintenance event, empty where nothing is."""
    to_come = cycle > following
    text = f"cycle {cycle} is to come, the next one is {following}: give that or an earlier one"
    return wrong_note(note) or (text if to_come else "")


class VerdictLog:
    """Stores what the aging monitor says of one valve: the twin owns the history.

    What touches the database runs on the history writer's thread.
    """

    def __init__(self, node: ValveNode, valve: LiveValve) -> None:
        self._node, self._valve = node, valve
        self._subscription = node.create_subscription(
            msg.Verdict, f"{valve.name}/aging_monitor/verdict", self._on_verdict, LATCHED
        )

    def destroy(self) -> None:
        """Stop listening."""
        self._node.destroy_subscription(self._subscription)

    def _on_verdict(self, message: Any) -> None:
        """Store a verdict on this valve; what is not known as a verdict is left out."""
        if message.verdict not in set(VerdictKind):
            return
        verdict = convert.to_value(Verdict, message)
        work = partial(self._valve.history.add_verdict, self._valve.name, verdict)
        self._valve.cycle_queue.writer.write_thread.submit(work, self._on_stored)

    def _on_stored(self, outcome: Outcome) -> None:
        if outcome.error:
            text = f"{self._valve.name}: verdict not stored: {outcome.error}"
            self._node.post(partial(self._node.get_logger().warning, text))


class LimitLog:
    """Stores where the trends of one valve stand to their limits, where that changes."""

    def __init__(self, node: ValveNode, valve: LiveValve) -> None:
        self._node, self._valve = node, valve
        self._last: dict[str, int] = {}
        model = get_model(valve.config.model)
        followed = valve.config.aging.parameters or [p.name for p in model.parameters if p.trend]
        self._subscriptions = [
            node.create_subscription(
                msg.Trend, f"{valve.name}/aging_monitor/trend/{name}", self._on_trend, LATCHED
            )
            for name in followed
        ]

    def destroy(self) -> None:
        """Stop listening."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)

    def _on_trend(self, message: Any) -> None:
        """Store a state that differs from the last one; what is not known as one is left out."""
        name, state = message.parameter, message.limit_state
        if state not in set(LimitState) or self._last.get(name) == state:
            return
        self._last[name] = state
        trend = convert.to_value(Trend, message)
        work = partial(self._valve.history.log.add_limit, self._valve.name, trend)
        self._valve.cycle_queue.writer.write_thread.submit(work, partial(self._on_stored, name))

    def _on_stored(self, name: str, outcome: Outcome) -> None:
        if outcome.error:
            self._last.pop(name, None)  # the next trend is stored instead
            text = f"{self._valve.name}: state of a limit not stored: {outcome.error}"
            self._node.post(partial(self._node.get_logger().warning, text))


class EventServices:
    """Lists and acknowledges the entries; what touches the database runs on its threads."""

    def __init__(self, node: ValveNode, valve: LiveValve) -> None:
        self._node, self._valve = node, valve
        base = f"{valve.name}/twin"
        self._deferred = [
            DeferredService(node, srv.GetEvents, f"{base}/get_events", self._get),
            DeferredService(
                node, srv.AcknowledgeEvent, f"{base}/acknowledge_event", self._acknowledge
            ),
        ]
        start = start_event(node.get_clock().now().nanoseconds, valve.last_cycle, __version__)
        work = partial(valve.history.log.add, valve.name, start)
        valve.cycle_queue.writer.write_thread.submit(work, self._on_started)

    def destroy(self) -> None:
        """Take the services down."""
        for service in self._deferred:
            service.destroy()

    def _on_started(self, outcome: Outcome) -> None:
        if outcome.error:
            text = f"{self._valve.name}: start not noted in the event log: {outcome.error}"
            self._node.post(partial(self._node.get_logger().warning, text))

    def _get(self, request: Any, response: Any, done: Done) -> None:
        valve = self._valve
        limit = min(int(request.limit) or DEFAULT_PAGE, MOST_OF_A_PAGE)

        def read() -> Any:
            log, first, only = valve.history.log, int(request.first_id), bool(request.open_only)
            found = log.events(valve.name, first, limit + 1, open_only=only)
            response.events = [convert.to_message(event) for event in found[:limit]]
            response.more, response.success = len(found) > limit, True
            return response

        def answer(outcome: Outcome) -> None:
            if outcome.error:
                response.success, response.message = False, outcome.error
            done(response)

        post = self._node.post
        valve.cycle_queue.writer.read_thread.submit(
            read, lambda outcome: post(partial(answer, outcome))
        )

    def _acknowledge(self, request: Any, response: Any, done: Done) -> None:
        valve, number = self._valve, int(request.id)
        by = Acknowledgement(request.who, request.note, self._node.get_clock().now().nanoseconds)

        def answer(outcome: Outcome) -> None:
            response.success = not outcome.error
            response.acknowledged = 0 if outcome.error else outcome.result
            told = outcome.error or f"{response.acknowledged} entries are acknowledged now"
            response.message = f"{valve.name}: {told}"
            done(response)

        post = self._node.post
        work = partial(valve.history.log.acknowledge, valve.name, number, by)
        valve.cycle_queue.writer.write_thread.submit(
            work, lambda outcome: post(partial(answer, outcome))
        )
