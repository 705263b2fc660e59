# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""One valve of the aging monitor: the stored history in, trends and verdict out.

The history of the twin is the only source: an estimate on the topic says that there is something
new to ask for. A monitor that was down therefore sees exactly what one sees that was not.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from valve_twin_msgs import msg, srv

from valve_twin.core.aging.assess import Assessment, assess
from valve_twin.core.aging.verdict import VerdictKind
from valve_twin.core.diagnosis.features import ESTIMATOR
from valve_twin.core.types import Maintenance
from valve_twin.core.valves.registry import get_model
from valve_twin.nodes.runtime import messages as convert
from valve_twin.nodes.twin.inputs import seconds_now
from valve_twin.nodes.twin.live_valve import LATCHED

if TYPE_CHECKING:
    from valve_twin.core.types import Estimate
    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.nodes.runtime.node import ValveNode
    from valve_twin.nodes.runtime.worker import Outcome, WorkerThread

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
    """

    def __init__(
        self, node: ValveNode, config: ValveConfig, *, worker: WorkerThread, page: int
    ) -> None:
        self._node, self.config, self._worker, self._page = node, config, worker, page
        self.name = config.name
        model = get_model(config.model)
        self._parameters, self._trend_estimator = model.parameters, model.trend_estimator
        self._wanted = 0
        self._history: list[Estimate] = []
        self._features: list[Estimate] = []
        self._of_features = False
        self._has_features = ESTIMATOR in getattr(config.options, "estimators", ())
        self._maintenance: dict[tuple[int, int, str], Maintenance] = {}
        self._asked_s: float | None = None
        self._again = True
        self._changed = False
        self._busy = False
        self.assessment: Assessment | None = None
        self.failure = ""
        self.assess_s = 0.0
        self._trends: dict[str, Any] = {}
        base = self.name
        self._verdict = node.create_publisher(
            msg.Verdict, f"{base}/aging_monitor/verdict", LATCHED
        )
        self._client = node.create_client(srv.GetHistory, f"{base}/twin/get_history")
        self._subscription: Any = None

    # -- life

    def listen(self) -> None:
        """Follow the twin."""
        self._again = True
        self._subscription = self._node.create_subscription(
            msg.Estimate, f"{self.name}/twin/estimate", self._on_estimate, LATCHED
        )

    def silence(self) -> None:
        """Stop following; what is known stays."""
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def close(self) -> None:
        """Take everything down."""
        self._node.destroy_client(self._client)
        for publisher in (self._verdict, *self._trends.values()):
            self._node.destroy_publisher(publisher)

    # -- catching up

    @property
    def cycles(self) -> int:
        """Estimates known."""
        return len(self._history)

    @property
    def last_cycle(self) -> int:
        """Last cycle known, 0 = none."""
        return self._history[-1].cycle if self._history else 0

    @property
    def twin_answers(self) -> bool:
        """Whether there is a twin to ask."""
        return bool(self._client.service_is_ready())

    def _on_estimate(self, message: msg.Estimate) -> None:
        if not message.stored:  # comes once more when there is something to ask for
            return
        if message.estimator == self._trend_estimator and message.cycle > self.last_cycle:
            self._wanted = max(self._wanted, int(message.cycle))
            self.ask(anew=True)

    def ask(self, *, anew: bool = False) -> None:
        """Ask for what is new, if there is reason to and a twin; one request at a time."""
        self._again = self._again or anew
        if self._asked_s is not None and seconds_now() - self._asked_s > ANSWER_S:
            self._asked_s = None
        if self._asked_s is not None or not self._again or not self.twin_answers:
            return
        self._asked_s, self._again = seconds_now(), False
        known = self._features if self._of_features else self._history
        request = srv.GetHistory.Request(
            estimator=ESTIMATOR if self._of_features else "",
            first_cycle=known[-1].cycle + 1 if known else 1,
            limit=self._page,
        )
        self._client.call_async(request).add_done_callback(self._on_answer)

    def _on_answer(self, future: Any) -> None:
        self._asked_s = None
        answer = future.result()
        if answer is None or not answer.success:
            self.failure = answer.message if answer is not None else "the twin did not answer"
            self._again = True
            return
        self.failure = ""
        pairs = zip(answer.estimates, answer.missed_cycles, strict=True)
        fresh = [convert.estimate_value(m, int(missed)) for m, missed in pairs]
        known = self._features if self._of_features else self._history
        last = known[-1].cycle if known else 0
        known += [e for e in fresh if e.cycle > last]
        events = [convert.to_value(Maintenance, m) for m in answer.maintenance]
        events_known = len(self._maintenance)
        self._maintenance |= {(e.cycle, e.stamp_ns, e.note): e for e in events}
        self._changed = self._changed or bool(fresh) or len(self._maintenance) != events_known
        if answer.more:
            self.ask(anew=True)
            return
        if self._has_features:  # they are asked for behind the estimates of the same cycles
            self._of_features = not self._of_features
            if self._of_features:
                self.ask(anew=True)
                return
        self._again = self._again or self.last_cycle < self._wanted  # not in the database yet
        self._assess()

    # -- assessing

    def _assess(self) -> None:
        """Assess the newest state off the loop; what changes meanwhile is assessed next."""
        if self._busy or not self._changed:
            return
        self._busy, self._changed = True, False
        work = partial(
            assess,
            (*self._history, *self._features),
            tuple(self._maintenance.values()),
            self.config.aging,
            parameters=self._parameters,
            valve=self.name,
        )
        post = self._node.post
        self._worker.submit(work, lambda outcome: post(partial(self._on_assessed, outcome)))

    def _on_assessed(self, outcome: Outcome) -> None:
        self._busy, self.assess_s = False, outcome.wall_s
        if outcome.error:
            self.failure = outcome.error
            self._node.get_logger().error(f"{self.name}: not assessed: {outcome.error}")
            return
        before, self.assessment = self.assessment, outcome.result
        self._publish(outcome.result)
        verdict = outcome.result.verdict
        if before is None or before.verdict.kind is not verdict.kind:
            text = f"{self.name}: {verdict.text}: {verdict.evidence}"
            if verdict.kind in (VerdictKind.OK, VerdictKind.NOT_ENOUGH_DATA):
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
