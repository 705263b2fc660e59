# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A simulated valve as a joint: what ros2_control's topic-based system and Isaac Sim speak."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Any

from sensor_msgs.msg import JointState

from valve_twin.io.config.topic_names import resolve_topic
from valve_twin.nodes.runtime.safety import PublishedTopic
from valve_twin.nodes.runtime.stamps import to_time

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.qos import QoSProfile

    from valve_twin.core.types import BoolArray, FloatArray, IntArray
    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.nodes.player.outbox import Outbox
    from valve_twin.nodes.runtime.node import ValveNode

STATES, COMMANDS = "joint_states", "joint_commands"


class JointFace:
    """The position of a valve as JointState, and its commands from one.

    A command names the joint, where the valve has one input, or the inputs themselves.

    Parameters
    ----------
    node : ValveNode
        The node.
    config : ValveConfig
        The valve.
    joint : str
        Name of the joint.
    stroke : float
        Position of the joint where the valve's is 1 [m].
    prefix : str
        What stands before both topics.
    inputs : tuple of str
        Inputs of the valve.
    """

    def __init__(
        self,
        node: ValveNode,
        config: ValveConfig,
        *,
        joint: str,
        stroke: float,
        prefix: str,
        inputs: tuple[str, ...],
    ) -> None:
        self._node, self._valve = node, config.name
        self._joint, self._stroke = joint, stroke
        self._states = resolve_topic(STATES, config.name, prefix)
        self._commands = resolve_topic(COMMANDS, config.name, prefix)
        self._inputs = {name: name for name in inputs}
        self._alone = len(inputs) == 1
        if self._alone:
            self._inputs[joint] = inputs[0]
        self._publisher: Any = None
        self._subscription: Any = None

    @property
    def published(self) -> PublishedTopic:
        """What it publishes."""
        return PublishedTopic(self._states, command=False)

    @property
    def publishers(self) -> list[Any]:
        """Its publisher, while it is open."""
        return [] if self._publisher is None else [self._publisher]

    def open(self, profile: QoSProfile, take: Callable[[str, float], None] | None) -> None:
        """Make the publisher and, where commands are taken, the subscription.

        Parameters
        ----------
        profile : QoSProfile
            Of both.
        take : callable or None
            Takes the name of an input and its value [1]; None = no commands are taken.
        """
        self._publisher = self._node.create_publisher(JointState, self._states, profile)
        if take is not None:
            self._subscription = self._node.create_subscription(
                JointState, self._commands, lambda message: self._taken(message, take), profile
            )

    def close(self) -> None:
        """Take both down."""
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
        self._publisher = self._subscription = None

    def put(
        self, outbox: Outbox, stamp_ns: IntArray, position: FloatArray, delivered: BoolArray
    ) -> None:
        """Queue samples, one message each; lost ones are not sent.

        Parameters
        ----------
        outbox : Outbox
            Where they are queued.
        stamp_ns : (N,) int64 array
            Stamps [ns].
        position : (N,) array
            Measured position [1].
        delivered : (N,) bool array
            Samples that were not lost.
        """
        for stamp, value, sent in zip(stamp_ns, position, delivered, strict=True):
            if sent:
                message = JointState(name=[self._joint], position=[float(value) * self._stroke])
                message.header.stamp = to_time(int(stamp))
                outbox.put(self._publisher, message)

    def _taken(self, message: JointState, take: Callable[[str, float], None]) -> None:
        """Take the positions of the names that are ours."""
        for k, name in enumerate(message.name):
            if name not in self._inputs:
                continue
            value = message.position[k] if k < len(message.position) else float("nan")
            if not isfinite(value):
                self._node.faults.report(
                    "simulation.command",
                    f"{self._commands}: '{name}' has no position that is a number; "
                    "the last command is held",
                    valve=self._valve,
                    subject=name,
                )
                continue
            of_joint = self._alone and name == self._joint
            take(self._inputs[name], value / self._stroke if of_joint else value)
