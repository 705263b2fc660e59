# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What of the diagnostics is made where nobody reads them."""

from types import SimpleNamespace
from typing import Any

from builtin_interfaces.msg import Time

from valve_twin.core.faults.kinds import FAULT_KINDS
from valve_twin.core.faults.lifetime import Fault, Status
from valve_twin.nodes.runtime.diagnostics import Diagnostics, Report

KIND = next(kind for kind in FAULT_KINDS if kind.code == "clock.waiting")
FAULT = Fault(KIND, "v1", "", Status.CONFIRMED, "no clock", 0, 0)


class FakeNode:
    """Gives a publisher with so many readers and a book of faults."""

    state, publishers = "active", ()

    def __init__(self):
        self.readers = self.stepped = 0
        self.sent: list[Any] = []
        self.publisher = SimpleNamespace(
            get_subscription_count=lambda: self.readers, publish=self.sent.append
        )
        self.faults = SimpleNamespace(
            look=lambda *_: None, step=self.step, faults=lambda unit: [FAULT] if unit else []
        )

    def step(self):
        self.stepped += 1

    def create_publisher(self, *_):
        return self.publisher

    def create_timer(self, *_, **__):
        return None

    def get_parameter(self, name):
        del name
        return SimpleNamespace(value=False)

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(to_msg=Time))

    def get_fully_qualified_name(self):
        return "/node"


def test_figures_are_made_where_somebody_reads_them_and_faults_are_filed_all_the_same():
    node: Any = FakeNode()
    made: list[int] = []
    filed: list[int] = []

    def figures():
        made.append(1)
        return {"cycle": 7}

    def reports():
        filed.append(1)
        return [Report("valve v1", "v1", figures=figures)]

    diagnostics = Diagnostics(node, reports)
    diagnostics.publish()
    assert (len(filed), node.stepped, made, node.sent) == (1, 1, [], [])
    node.readers = 1
    diagnostics.publish()
    assert (len(filed), len(made)) == (2, 1)
    status = node.sent[0].status[0]
    values = {v.key: v.value for v in status.values}
    assert values["cycle"] == "7"
    assert values["fault.clock.waiting.evidence"] == "no clock"
    assert status.message == "no clock"
