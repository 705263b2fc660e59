# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The signals of one valve on their way to the core: subscribed, decoded, gathered in step."""

from __future__ import annotations

import time
from functools import partial
from typing import TYPE_CHECKING, Any

from valve_twin.core.signal_clocks import ClockOffset, SignalClocks
from valve_twin.nodes.runtime.second_reader import Pace
from valve_twin.nodes.twin.collector import Collector
from valve_twin.nodes.twin.inputs import InputConfig, TopicInput, seconds_now

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from valve_twin.io.cdr.signals import Extractor, SignalBlock
    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.nodes.runtime.node import ValveNode

BACKLOG_NS = 1_000_000
"""A message that waited longer is worked on with all that waits behind it: low rates are
answered at once, in a rush whole blocks [ns]."""

LONGEST_GATHER_S = 0.02
"""No sample waits longer than this to be handed on [s]."""


class ValveInputs:
    """Topics in, rounds of blocks out.

    Parameters
    ----------
    node : ValveNode
        The twin node.
    config : ValveConfig
        The valve.
    signals : sequence of list of Extractor
        The signals by topic.
    output : str
        The signal that is predicted: with its sample an answer is due.
    gather_s : float
        Samples are gathered for so long where predictions are collected; 0 = answer at once [s].
    on_ready : callable
        Called when something has come: True where it is to be taken now.

    Attributes
    ----------
    topics : list of TopicInput
        The subscriptions; empty while nothing is listened to.
    """

    def __init__(
        self,
        node: ValveNode,
        config: ValveConfig,
        signals: Sequence[list[Extractor]],
        *,
        output: str,
        gather_s: float,
        on_ready: Callable[[bool], None],
    ) -> None:
        self._node, self._signals, self._on_ready = node, signals, on_ready
        self._gather_s = gather_s
        self._collector = Collector(config.signals, round(1e9 * config.hold_back_s))
        self._leading = next(
            i for i, group in enumerate(signals) if output in {e.source.signal for e in group}
        )
        self._output, self._pace = output, Pace()
        self._clocks = SignalClocks(output, config.hold_back_s)
        self._fresh: set[int] = set()
        self._scheduled = False
        self.due_s = 0.0
        self.topics: list[TopicInput] = []

    def __bool__(self) -> bool:
        """Return whether samples wait to be handed on."""
        return bool(self._collector)

    @property
    def oldest_ns(self) -> int:
        """When the middleware received the oldest sample that was gathered [ns]."""
        return self._collector.oldest_ns

    def listen(self, config: InputConfig) -> None:
        """Subscribe to all signals."""
        now_ns = self._receive_clock()
        self.topics = [
            TopicInput(self._node, group, config, partial(self._arrive, i), self._gather, now_ns)
            for i, group in enumerate(self._signals)
        ]

    def silence(self) -> None:
        """Take the subscriptions down."""
        for topic in self.topics:
            topic.destroy()
        self.topics = []

    def put_off(self, now_s: float) -> None:
        """Gather until a time after now; all valves that collect are due at one time [s]."""
        if self._gather_s:
            self.due_s = (now_s // self._gather_s + 1.0) * self._gather_s
        else:
            self.due_s = now_s + LONGEST_GATHER_S

    def take(self, now_s: float, *, everything: bool) -> Iterable[list[SignalBlock]]:
        """Return rounds of blocks of all signals, in step.

        Parameters
        ----------
        now_s : float
            The steady clock [s].
        everything : bool
            Wait for no signal that lags behind the others.
        """
        self._scheduled = False
        self.put_off(now_s)
        for topic in self.topics:
            topic.drain()
        return self._collector.take_all() if everything else self._collector.take(now_s)

    def look_at_clocks(self) -> list[ClockOffset]:
        """Return how far the signals' clocks run apart; not told in a rush, see `Pace`."""
        found = self._clocks.look()
        return [] if self._pace.is_rush(seconds_now()) else found

    def answered(self) -> None:
        """Note that what the topics brought has been predicted."""
        self._fresh.clear()

    def _gather(self, block: SignalBlock, received_ns: int) -> None:
        newest_ns, now_s = int(block.stamp_ns[-1]), seconds_now()
        ahead_ns = newest_ns - received_ns
        self._clocks.note(block.signal, ahead_ns, has_header=block.has_header)
        if block.signal == self._output:
            self._pace.note(newest_ns, now_s)
        self._collector.add(block, received_ns, now_s)

    def _arrive(self, topic: int, received_ns: int) -> None:
        """Answer once every topic has brought something, late ones together with what follows."""
        self._on_ready(False)
        if self._gather_s:
            return
        self._fresh.add(topic)
        complete = len(self._fresh) == len(self._signals)
        if complete and time.time_ns() - received_ns < BACKLOG_NS:
            self._on_ready(True)
        elif (complete or topic == self._leading) and not self._scheduled:
            self._scheduled = True
            self._node.later(partial(self._on_ready, True))

    def _receive_clock(self) -> Any:
        """Return the node's clock; simulated time is 0 before the first /clock."""
        if not self._node.get_parameter("use_sim_time").value:
            return time.time_ns
        clock = self._node.get_clock()
        return lambda: clock.now().nanoseconds
