# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""One valve of the aging monitor: estimates and maintenance events in, trends and verdict out.

Estimates come from the messages of the twin; its history is asked for what came before and for
what was missed. A monitor that was down therefore sees exactly what one sees that was not.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from rclpy.qos import DurabilityPolicy, QoSProfile
from valve_twin_msgs import msg, srv

from valve_twin.core.aging.assess import Assessment, assess
from valve_twin.core.aging.cutting.ahead import look_ahead
from valve_twin.core.aging.cutting.memory import Memory
from valve_twin.core.diagnosis.features import ESTIMATOR
from valve_twin.core.types import Maintenance
from valve_twin.core.valves.registry import get_model
from valve_twin.nodes.aging.estimate_buffer import AGAIN, EstimateBuffer
from valve_twin.nodes.runtime import messages as convert
from valve_twin.nodes.twin.inputs import seconds_now
from valve_twin.nodes.twin.publishers import LATCHED

if TYPE_CHECKING:
    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.nodes.aging.keeping import Keeper
    from valve_twin.nodes.runtime.node import ValveNode
    from valve_twin.nodes.runtime.worker import Outcome, WorkerThread

MANY = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)

ANSWER_S = 5.0
"""A request that is not answered within this time is given up: the twin went away [s]."""


class MonitoredValve:
    """One valve that is followed.

    Parameters
    ----------
    node : ValveNode
        The aging monitor.
    config : ValveConfig
        The valve.
    worker : WorkerThread
        Runs the assessments.
    page : int
        Estimates asked for at a time.
    keeper : Keeper
        Keeps what is known for the next start.
    """

    def __init__(
        self,
        node: ValveNode,
        config: ValveConfig,
        *,
        worker: WorkerThread,
        page: int,
        keeper: Keeper,
    ) -> None:
        self._node, self.config, self._worker, self._page = node, config, worker, page
        self.name = config.name
        model = get_model(config.model)
        self._parameters, self._trend_estimator = model.parameters, model.trend_estimator
        self._features = ESTIMATOR in config.options.estimators
        self._sought: set[int] = set()
        self._begin()
        self._asked_s: float | None = None
        self._again = True
        self._answered = self._caught_up = False
        self._changed = False
        self._busy = False
        self._keeper = keeper
        self.assessment: Assessment | None = None
        self.failure = self._told = ""
        self._unkept = keeper.trouble
        self.assess_s = 0.0
        self._trends: dict[str, Any] = {}
        base = self.name
        self._verdict = node.create_publisher(
            msg.Verdict, f"{base}/aging_monitor/verdict", LATCHED
        )
        self._client = node.create_client(srv.GetHistory, f"{base}/twin/get_history")
        self._subscriptions: list[Any] = []
        self._take_over()

    # -- life

    def listen(self) -> None:
        """Follow the twin."""
        self._again, self._caught_up = True, False
        for kind, name, take in (
            (msg.CycleSummary, "cycle", self._on_cycle),
            (msg.Estimate, "estimate", self._on_estimate),
            (msg.Maintenance, "maintenance", self._on_maintenance),
        ):
            self._subscriptions.append(
                self._node.create_subscription(kind, f"{self.name}/twin/{name}", take, MANY)
            )

    def _begin(self) -> None:
        """Begin with nothing known."""
        beside = ESTIMATOR if self._features else ""
        again = min(AGAIN, self._page)
        self._buffer = EstimateBuffer(self._trend_estimator, beside, again, self._sought)
        self._asking = list(self._buffer.counts)
        self._memory = Memory()

    def _take_over(self) -> None:
        """Begin with what was kept, where something was."""
        known = self._keeper.load(self._node.get_logger().warning)
        if known is not None and self._buffer.take_over(known.state, known.place):
            self._memory = known.memory
            self._changed = True

    def silence(self) -> None:
        """Stop following; what is known stays."""
        self._keep(ends=True)
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions = []

    def close(self) -> None:
        """Take everything down."""
        self._node.destroy_client(self._client)
        for publisher in (self._verdict, *self._trends.values()):
            self._node.destroy_publisher(publisher)

    # -- catching up

    @property
    def cycles(self) -> int:
        """Estimates known."""
        return self._buffer.counts[self._trend_estimator]

    @property
    def last_cycle(self) -> int:
        """Last cycle known, 0 = none."""
        return self._buffer.last()

    @property
    def twin_answers(self) -> bool:
        """Whether there is a twin to ask."""
        return bool(self._client.service_is_ready())

    def look(self) -> None:
        """Ask for what did not come by itself, and after the twin was away."""
        answers = self.twin_answers
        self.ask(anew=self._buffer.waits or (answers and not self._answered))
        self._answered = answers

    def _on_cycle(self, message: msg.CycleSummary) -> None:
        self._buffer.receive_cycle(message)
        self._take()

    def _on_estimate(self, message: msg.Estimate) -> None:
        self._buffer.receive(message)
        if not self._reads_anew():
            self._take()

    def _reads_anew(self) -> bool:
        """Return whether all is read anew, since a cycle before the last one came late.

        What is being read is read to its end first, so that many late cycles delay no verdict.
        """
        if not self._buffer.late or not self._caught_up or self._asked_s is not None:
            return False
        self._node.get_logger().info(f"{self.name}: a cycle was stored late: all are read anew")
        self._keeper.outdated()
        self._caught_up = False
        self._begin()
        self.ask(anew=True)
        return True

    def _on_maintenance(self, message: msg.Maintenance) -> None:
        if self._buffer.note(convert.to_value(Maintenance, message)) and self._caught_up:
            self._changed = True
            self._assess()

    def _take(self) -> None:
        """Take over what was received, once all that came before is known."""
        if not self._caught_up or self._asked_s is not None:
            self.ask()
            return
        self._changed = self._buffer.take() or self._changed
        self._assess()
        if self._buffer.lacks:
            self.ask(anew=True)

    def ask(self, *, anew: bool = False) -> None:
        """Ask for what is new, if there is reason to and a twin; one request at a time."""
        self._again = self._again or anew
        if self._asked_s is not None and seconds_now() - self._asked_s > ANSWER_S:
            self._asked_s = None
        if self._asked_s is not None or not self._again or not self.twin_answers:
            return
        self._asked_s, self._again, self._answered = seconds_now(), False, True
        request = srv.GetHistory.Request(
            estimator=self._asking[0],
            first_cycle=self._buffer.first_wanted[self._asking[0]],
            limit=self._page,
        )
        answered = partial(self._on_answer, self._buffer)
        self._client.call_async(request).add_done_callback(answered)

    def _on_answer(self, asking: EstimateBuffer, future: Any) -> None:
        if asking is not self._buffer:
            return  # asked long ago: what is known now began anew since
        self._asked_s = None
        answer = future.result()
        if answer is None or not answer.success:
            self.failure = answer.message if answer is not None else "the twin did not answer"
            self._again = True
            return
        self.failure = ""
        if answer.message and answer.message != self._told:
            self._told = answer.message
            self._node.get_logger().info(f"{self.name}: {self._told}")
        pairs = zip(answer.estimates, answer.missed_cycles, strict=True)
        fresh = [convert.estimate_value(m, int(missed)) for m, missed in pairs]
        events = [convert.to_value(Maintenance, m) for m in answer.maintenance]
        changes = [*map(self._buffer.note, events)]
        if self._asking[0] == self._trend_estimator and self._buffer.contradicts(fresh):
            self._keeper.outdated()
            self._begin()
            self.ask(anew=True)
            return
        changes.append(self._buffer.add(self._asking[0], fresh))
        self._changed = self._changed or any(changes)
        if not answer.more:  # the estimators are asked for one behind the other
            self._asking = self._asking[1:] or list(self._buffer.counts)
        if answer.more or self._asking[0] != self._trend_estimator:
            self.ask(anew=True)
            return
        self._caught_up = True
        self._changed = self._buffer.take() or self._changed
        self._assess()
        self._reads_anew()

    # -- assessing

    def _assess(self) -> None:
        """Assess the newest state off the loop; what changes meanwhile is assessed next.

        A history that is half read is not assessed.
        """
        if self._busy or not self._changed or not self._caught_up:
            return
        self._busy, self._changed = True, False
        known = (
            self._buffer.past,
            tuple(self._buffer.maintenance.values()),
            self.config.aging,
        )
        common: dict[str, Any] = {"parameters": self._parameters, "memory": self._memory}
        work = partial(assess, *known, valve=self.name, **common)
        post = self._node.post
        self._worker.submit(work, lambda outcome: post(partial(self._on_assessed, outcome)))
        self._worker.submit(partial(look_ahead, *known, **common), lambda _: None)
        self._keep()

    def _keep(self, *, ends: bool = False) -> None:
        """Write what is known for the next start, where that is due."""
        if self._caught_up and self._keeper.due(self._buffer, ends=ends):
            work = self._keeper.saving(self._buffer, self._memory)
            post = self._node.post
            self._worker.submit(work, lambda outcome: post(partial(self._on_kept, outcome)))

    def _on_kept(self, outcome: Outcome) -> None:
        self._keeper.done(failed=bool(outcome.error))
        if outcome.error and not self._unkept:
            self._node.get_logger().warning(f"{self.name}: {outcome.error}")
        if self._unkept and not outcome.error:
            self._node.get_logger().info(f"{self.name}: what is known is kept again")
        self._unkept = outcome.error

    def _on_assessed(self, outcome: Outcome) -> None:
        self._busy, self.assess_s = False, outcome.wall_s
        if outcome.error:
            self.failure = outcome.error
            self._node.get_logger().error(f"{self.name}: not assessed: {outcome.error}")
            return
        before, self.assessment = self.assessment, outcome.result
        self._publish(outcome.result)
        verdict = outcome.result.verdict
        if before is None or before.verdict.text != verdict.text:
            text = f"{self.name}: {verdict.text}: {verdict.evidence}"
            if not verdict.kind.asks_for_help:
                self._node.get_logger().info(text)
            else:  # on a line of its own: a logger refuses another severity from the same line
                self._node.get_logger().warning(text)
        self._assess()

    def _publish(self, assessment: Assessment) -> None:
        for trend in assessment.trends:
            if trend.parameter not in self._trends:
                topic = f"{self.name}/aging_monitor/trend/{trend.parameter}"
                self._trends[trend.parameter] = self._node.create_publisher(
                    msg.Trend, topic, LATCHED
                )
            self._trends[trend.parameter].publish(convert.to_message(trend))
        self._verdict.publish(convert.to_message(assessment.verdict))
