# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Topics and services of one simulated valve."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from valve_twin_msgs import msg, srv

from valve_twin.core.simulation.valve import SimulatedValve
from valve_twin.core.valves.registry import get_model
from valve_twin.io.cdr.codec import encode_series, encode_stamped
from valve_twin.io.cdr.signals import SERIES_TYPE, STAMPED_TYPE, SignalSource
from valve_twin.io.config.topic_names import resolve_topic
from valve_twin.nodes.runtime.safety import PublishedTopic
from valve_twin.nodes.simulator.joint import JointFace
from valve_twin.nodes.twin.inputs import InputConfig, TopicInput, by_topic, seconds_now

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile

    from valve_twin.core.simulation.block import SimulationBlock
    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.nodes.player.outbox import Outbox
    from valve_twin.nodes.runtime.node import ValveNode


class SimulatedTopics:
    """One simulated valve on the network.

    Parameters
    ----------
    node : ValveNode
        The node.
    config : ValveConfig
        Name and model of the valve.
    simulation : SimulationConfig
        The simulation.
    seed : int
        Seed of its random numbers.
    prefix : str
        What stands before all its topics.
    batch : int
        Samples a message.
    joint : str
        Name of the joint as which it shows, too; empty = none.
    stroke : float
        Position of the joint where the valve's is 1 [m].
    """

    def __init__(
        self,
        node: ValveNode,
        config: ValveConfig,
        simulation: SimulationConfig,
        *,
        seed: int,
        prefix: str,
        batch: int,
        joint: str = "",
        stroke: float = 1.0,
    ) -> None:
        self._node, self._config, self._batch = node, config, batch
        self.simulation = simulation
        model = get_model(config.model)
        self._external = simulation.controller == "external"
        topic = partial(_published_topic, config, prefix)
        self._command_topics = {n: topic(n, _command_topic(n)) for n in model.inputs}
        self._topics = {
            "position": topic(model.output, model.output),
            "cycle": topic("cycle_counter", "cycle"),
        }
        if not self._external:
            self._topics["reference"] = topic("reference", "reference")
            self._topics |= self._command_topics
        self.published_topics = [
            PublishedTopic(t, command=k in model.inputs) for k, t in self._topics.items()
        ]
        self._joint = None
        if joint:
            self._joint = JointFace(
                node, config, joint=joint, stroke=stroke, prefix=prefix, inputs=model.inputs
            )
            self.published_topics.append(self._joint.published)
        self._inputs_order = model.inputs
        self._valve = SimulatedValve(simulation, seed)
        self._publishers: dict[str, Any] = {}
        self._takers: list[TopicInput] = []
        self._commands = np.zeros(len(model.inputs))
        self._start_ns = 0
        base = f"{config.name}/simulated_valve"
        self._services = [
            node.create_service(srv.SetAging, f"{base}/set_aging", self._set_aging),
            node.create_service(srv.InjectFault, f"{base}/inject_fault", self._inject_fault),
        ]

    @property
    def period_s(self) -> float:
        """Time from one call of `advance` to the next [s]."""
        return self.simulation.period_s * self._batch

    @property
    def publishers(self) -> list[Any]:
        """All publishers."""
        return [*self._publishers.values(), *(self._joint.publishers if self._joint else ())]

    @property
    def awaited(self) -> list[Any]:
        """Publishers of position and commands: what a twin cannot do without."""
        return [p for n, p in self._publishers.items() if n not in {"cycle", "reference"}]

    def open(self, profile: QoSProfile, start_ns: int) -> None:
        """Make the publishers; the first sample is stamped `start_ns`."""
        kind = msg.Float64Stamped if self._batch == 1 else msg.Float64Series
        self._publishers = {
            name: self._node.create_publisher(kind, topic, profile)
            for name, topic in self._topics.items()
        }
        if self._joint:
            self._joint.open(profile, self._hold if self._external else None)
        self._start_ns = start_ns - self._valve.time_ns
        if self._external:
            sources = [SignalSource(n, t, STAMPED_TYPE) for n, t in self._command_topics.items()]
            self._takers = [
                TopicInput(self._node, group, InputConfig(), self._arrived, self._take, lambda: 1)
                for group in by_topic(self._node, sources)
            ]

    def _arrived(self, received_ns: int) -> None:
        """Take a command at once."""
        del received_ns
        for taker in self._takers:
            taker.drain()

    def look(self) -> None:
        """Listen anew where a subscription is deaf."""
        now_s = seconds_now()
        for taker in self._takers:
            taker.look(now_s)

    def close(self) -> None:
        """Take publishers and subscriptions down."""
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)
        for taker in self._takers:
            taker.destroy()
        if self._joint:
            self._joint.close()
        self._publishers, self._takers = {}, []

    def destroy(self) -> None:
        """Take the services down."""
        for service in self._services:
            self._node.destroy_service(service)

    def advance(self, outbox: Outbox, cycles: int) -> int:
        """Simulate one message's samples and queue them, commands before the position.

        Returns
        -------
        int
            Stamp of the last sample [ns], 0 where `cycles` are done (0 = never).
        """
        if (
            cycles
            and self._valve.time_ns
            >= cycles * self.simulation.cycle_samples * self._valve.period_ns
        ):
            return 0
        given = np.tile(self._commands, (self._batch, 1)) if self._external else None
        block = self._valve.advance(self._batch, given)
        if self._valve.failure:
            self._node.faults.report(
                "simulation.failed", self._valve.failure, valve=self._config.name
            )
        stamps = block.stamp_ns + self._start_ns
        columns = self._columns(block)
        for name, values in columns.items():
            publisher = self._publishers[name]
            if self._batch > 1:
                outbox.put(
                    publisher, encode_series(int(stamps[0]), self.simulation.period_s, values)
                )
            elif name != "position" or block.delivered[0]:
                outbox.put(publisher, encode_stamped(int(stamps[0]), float(values[0])))
        if self._joint:
            self._joint.put(outbox, stamps, block.position, block.delivered)
        return int(stamps[-1])

    def _columns(self, block: SimulationBlock) -> dict[str, Any]:
        """Return what is published in its order; a lost sample of a batch has no value."""
        columns: dict[str, Any] = {"cycle": block.cycle.astype(np.float64)}
        if not self._external:
            columns["reference"] = block.reference
            for i, name in enumerate(self._inputs_order):
                columns[name] = block.inputs[:, i]
        columns["position"] = np.where(block.delivered, block.position, np.nan)
        return columns

    def _take(self, block: Any, received_ns: int) -> None:
        """Take the newest command of a topic."""
        del received_ns
        self._hold(block.signal, float(block.values[-1]))

    def _hold(self, signal: str, value: float) -> None:
        """Hold a command; one that is no number keeps the last, one beyond is limited."""
        low, high = self.simulation.plant.command_range
        if not low <= value <= high:
            done = "limited" if np.isfinite(value) else "the last one is held"
            self._node.faults.report(
                "simulation.command",
                f"{signal} = {value:g}: must be a number from {low:g} to {high:g} [1]; {done}",
                valve=self._config.name,
                subject=signal,
            )
        if np.isfinite(value):
            self._commands[self._inputs_order.index(signal)] = value

    def _set_aging(self, request: Any, response: Any) -> Any:
        return _answer(
            response,
            lambda: self._valve.set_aging(
                request.parameter, request.law, request.rate, int(request.start_cycle)
            ),
        )

    def _inject_fault(self, request: Any, response: Any) -> Any:
        return _answer(
            response,
            lambda: self._valve.set_fault(request.kind, request.severity, request.duration),
        )


def _published_topic(config: ValveConfig, prefix: str, signal: str, default: str) -> str:
    """Return where a signal is published: below the prefix, there where the twin has it mapped.

    A signal that is mapped to a part of another message, or scaled, goes to its default.
    """
    source = config.signals.get(signal)
    shared = source is not None and [s.topic for s in config.signals.values()].count(source.topic)
    plain = source is not None and (source.type, source.field, source.scale, source.offset) in {
        (STAMPED_TYPE, "value", 1.0, 0.0),
        (SERIES_TYPE, "values[]", 1.0, 0.0),
    }
    if source is None or shared != 1 or not plain:
        return resolve_topic(default, config.name, prefix)
    head = f"/{prefix.strip('/')}/"
    inside = prefix.strip("/") and source.topic.startswith(head)
    return source.topic if inside else resolve_topic(source.topic, config.name, prefix)


def _command_topic(name: str) -> str:
    """Return the topic that a configuration maps a command to by default."""
    return name if name == "command" else f"command/{name}"


def _answer(response: Any, action: Any) -> Any:
    """Do it and say what was done, or what is wrong."""
    try:
        response.message = action()
        response.success = True
    except ValueError as err:
        response.success, response.message = False, str(err)
    return response
