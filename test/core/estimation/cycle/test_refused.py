# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A cycle on which a model's own code fails is refused, and the next one is estimated."""

import numpy as np

from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.refusal import RefusalCode
from valve_twin.core.simulation import simulate_cycles, to_frames
from valve_twin.core.types import Cycle, EstimateStatus
from valve_twin.core.valves.first_order import VALVE
from valve_twin.core.valves.registry import get_simulation


class Failing:
    """A valve whose code fails on its second cycle."""

    def __getattr__(self, name):
        return getattr(VALVE, name)

    def estimate(self, cycle, options, earlier=()):
        if cycle.number == 2:
            raise ValueError("min() of\n nothing, " + "very " * 200 + "long")
        return VALVE.estimate(cycle, options, earlier)


def test_only_the_cycle_on_which_the_code_fails_is_refused():
    model, memory, told = Failing(), Memory.empty(), []
    simulation = get_simulation(VALVE.name)
    for number, block in enumerate(simulate_cycles(simulation, 3, 1), 1):
        cycle = Cycle(number, simulation.period_s, to_frames(block))
        found, memory = estimate_cycle(model, VALVE.options, cycle, memory)
        told.append(found[0])
    assert [e.status is EstimateStatus.REFUSED for e in told] == [False, True, False]
    failed = told[1]
    assert failed.reason_code == RefusalCode.FAILED
    assert failed.reason.startswith("the code of first_order failed: ValueError in estimate, line")
    assert failed.reason.endswith("report it with the record of this cycle")
    assert "\n" not in failed.reason
    assert len(failed.reason) < 400
    assert np.isnan([p.value for p in failed.parameters]).all()
