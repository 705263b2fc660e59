# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How long a prediction may wait for the estimate that its cycle is due.

Equal bits ask that a cycle waits for the estimate of the second one before. A live plant does not
wait: beyond a bound the model in force goes on, and what comes of it says that it is not
reproducible. A replay waits for ever.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from valve_twin.io.config.node_parameters import TwinParameters
from valve_twin.nodes.runtime.safety import is_replayed

if TYPE_CHECKING:
    from collections.abc import Iterable

    from valve_twin.nodes.runtime.node import ValveNode


class EstimateWait:
    """The wait of one valve, on the steady clock.

    Parameters
    ----------
    limit_s : float
        Longest wait [s]; infinite = for ever.

    Attributes
    ----------
    cut : int
        Waits that were cut off [1].
    """

    def __init__(self, limit_s: float) -> None:
        self.limit_s = limit_s
        self._since_s: float | None = None
        self.cut = 0

    @property
    def is_bounded(self) -> bool:
        """Whether samples wait now, and not for ever."""
        return self._since_s is not None and math.isfinite(self.limit_s)

    def note(self, waits: bool, now_s: float) -> None:
        """Note whether samples wait; a wait begins with the first time that they do."""
        if not waits:
            self._since_s = None
        elif self._since_s is None:
            self._since_s = now_s

    def is_over(self, now_s: float) -> bool:
        """Return whether the wait has reached its limit; it is then counted and forgotten."""
        if self._since_s is None or now_s - self._since_s < self.limit_s:
            return False
        self._since_s = None
        self.cut += 1
        return True


def longest_wait_s(node: ValveNode, topics: Iterable[str]) -> float:
    """Return how long a valve's predictions wait for an estimate [s].

    Parameters
    ----------
    node : ValveNode
        The twin node; its `estimate_wait_s` holds for live inputs only.
    topics : iterable of str
        Topics of the valve's signals.

    Returns
    -------
    float
        Infinite where the parameter is 0, where the clock is simulated, and where every topic
        lies below a name of a replay.
    """
    limit_s = node.parameters.read(TwinParameters).estimate_wait_s
    simulated = bool(node.get_parameter("use_sim_time").value)
    replayed = all(is_replayed(node.resolve_topic_name(topic)) for topic in topics)
    return math.inf if limit_s == 0.0 or simulated or replayed else limit_s
