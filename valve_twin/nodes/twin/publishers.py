# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What one valve's twin says: predictions, closed cycles and estimates onto their topics."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from valve_twin_msgs import msg

from valve_twin.core.diagnosis.generic.reference import published
from valve_twin.core.gaps import GapCounter
from valve_twin.core.operation.step_metrics import MOST_STEPS, worth_telling
from valve_twin.io.config.node_parameters import TwinParameters
from valve_twin.nodes.runtime import messages as convert
from valve_twin.nodes.twin.inputs import seconds_now
from valve_twin.nodes.twin.prediction_batches import PredictionBatches, mean_period_s

if TYPE_CHECKING:
    from collections.abc import Iterable

    from valve_twin.core.operation.counters import Counters
    from valve_twin.core.operation.step_metrics import StepMetrics
    from valve_twin.core.types import Cycle, Prediction
    from valve_twin.core.valves.interface import ValveModel
    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.nodes.runtime.node import ValveNode
    from valve_twin.nodes.twin.history.writer import QueuedCycle

LONGEST_GATHER_S = 0.25
"""Where predictions are collected, inputs are worked on this often at least: one round costs
hardly more than one sample [s]."""

LATCHED = QoSProfile(
    depth=10,
    history=HistoryPolicy.KEEP_LAST,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""State topics: a late reader of depth 1 gets the newest, a deeper one all estimators."""

LAST = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Counters: the newest say all."""

STEPS = QoSProfile(depth=2 * MOST_STEPS, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Step metrics: one message a step, the last cycle's for who comes late."""

_DEEP = QoSProfile(depth=5000, reliability=ReliabilityPolicy.RELIABLE)
_DEEP_SERIES = QoSProfile(depth=300, reliability=ReliabilityPolicy.RELIABLE)


class ValvePublishers:
    """The publishers of one valve.

    Parameters
    ----------
    node : ValveNode
        The twin node; its `prediction_batch_s` says how predictions are collected.
    config : ValveConfig
        The valve.
    model : ValveModel
        Its model.

    Attributes
    ----------
    gather_s : float
        How long inputs may be gathered, as their predictions are collected anyway; 0 = not [s].
    predicted : int
        Samples that were predicted [1].
    gaps : GapCounter
        Gaps between them.
    """

    def __init__(self, node: ValveNode, config: ValveConfig, model: ValveModel) -> None:
        self._node, self._valve, self._model = node, config.name, model
        self._period_s = config.period_s
        self.units = convert.units_of(published(model))
        self.predicted = 0
        self.gaps = GapCounter(config.period_s)
        batch_s = node.parameters.read(TwinParameters).prediction_batch_s
        self.gather_s = min(batch_s, LONGEST_GATHER_S)
        self._batches: PredictionBatches | None = None
        if batch_s > 0.0:
            self._batches = PredictionBatches(batch_s, config.period_s, batch_s + self.gather_s)
        self._in_series = batch_s > 0.0 or config.signals[model.output].batched
        kind = msg.PredictionSeries if self._in_series else msg.Prediction
        base, depth = f"{config.name}/twin", _DEEP_SERIES if self._in_series else _DEEP
        self._prediction = node.create_publisher(kind, f"{base}/prediction", depth)
        self._cycle = node.create_publisher(msg.CycleSummary, f"{base}/cycle", LATCHED)
        self._estimate = node.create_publisher(msg.Estimate, f"{base}/estimate", LATCHED)
        self._counters = node.create_publisher(msg.Counters, f"{base}/counters", LAST)
        self._steps = node.create_publisher(msg.StepMetrics, f"{base}/step_metrics", STEPS)

    def __bool__(self) -> bool:
        """Return whether predictions wait to fill a message."""
        return bool(self._batches)

    @property
    def due_s(self) -> float:
        """When what waits has to leave, on the steady clock; infinite where nothing waits [s]."""
        return self._batches.due_s if self._batches is not None else math.inf

    def close(self) -> None:
        """Publish what waits, take the publishers down."""
        self.flush()
        states = (self._cycle, self._estimate, self._counters, self._steps)
        for publisher in (self._prediction, *states):
            self._node.destroy_publisher(publisher)

    def predict(self, prediction: Prediction) -> None:
        """Publish predictions, at once or when they fill a message."""
        self.predicted += len(prediction.stamp_ns)
        self.gaps.push(prediction.stamp_ns)
        if self._batches is not None:
            self._publish_series(self._batches.add(prediction, seconds_now()))
            return
        made = (
            convert.series_bytes(prediction, self._period_s)
            if self._in_series
            else convert.prediction_bytes(prediction)
        )
        publish = self._prediction.publish
        for data in made:
            publish(data)

    def flush(self) -> None:
        """Publish the predictions that were collected."""
        if self._batches:
            self._publish_series(self._batches.flush())

    def close_cycle(self, cycle: Cycle) -> None:
        """Publish the summary of a closed cycle."""
        self._cycle.publish(convert.cycle_message(self._valve, cycle))

    def estimate(self, queued: QueuedCycle, stored: bool) -> None:
        """Publish a cycle's estimates; the one that feeds the trend last, to be latched."""
        trend = self._model.trend_estimator
        for estimate in sorted(queued.estimates, key=lambda e: e.estimator == trend):
            self._estimate.publish(
                convert.estimate_message(
                    self._valve, estimate, self.units, stored=stored, wall_s=queued.wall_s
                )
            )
        if stored and queued.counters is not None:
            self.count(queued.counters)

    def count(self, counters: Counters) -> None:
        """Publish what is counted in the history."""
        if counters.cycles:
            self._counters.publish(convert.counters_message(self._valve, counters))

    def steps(self, found: Iterable[StepMetrics]) -> None:
        """Publish what the steps of a cycle tell, one message each, and once why others do not."""
        for step in worth_telling(found):
            self._steps.publish(convert.step_message(self._valve, step))

    def _publish_series(self, series: Iterable[Prediction]) -> None:
        for prediction in series:
            period_s = mean_period_s(prediction, self._period_s)
            for data in convert.series_bytes(prediction, period_s):
                self._prediction.publish(data)
