# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Keep what the aging monitor says: the twin owns the history, so it listens and stores."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from valve_twin_msgs import msg

from valve_twin.core.aging.verdict import Verdict, VerdictKind
from valve_twin.nodes.runtime.messages import to_value
from valve_twin.nodes.twin.live_valve import LATCHED

if TYPE_CHECKING:
    from valve_twin.nodes.runtime.node import ValveNode
    from valve_twin.nodes.runtime.worker import Outcome
    from valve_twin.nodes.twin.live_valve import LiveValve


class VerdictLog:
    """Stores the verdicts on one valve; what touches the database runs on its keeper's thread."""

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
        work = partial(
            self._valve.history.add_verdict, self._valve.name, to_value(Verdict, message)
        )
        self._valve.kept.keeper.writer.submit(work, self._on_stored)

    def _on_stored(self, outcome: Outcome) -> None:
        if outcome.error:
            text = f"{self._valve.name}: verdict not stored: {outcome.error}"
            self._node.post(partial(self._node.get_logger().warning, text))
