# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compile every kernel once, at installation, so that no node compiles in a callback.

Runs one short record of each valve through simulation, twin, estimation and aging; numba keeps
what it compiled.
"""

from __future__ import annotations

import numpy as np

from valve_twin.core import aging
from valve_twin.core.alignment import SignalRange
from valve_twin.core.cycles import CycleConfig
from valve_twin.core.estimation.sequence import estimate_cycle
from valve_twin.core.simulation import SimulatedValve
from valve_twin.core.twin import Twin, TwinConfig
from valve_twin.core.types import CycleRule
from valve_twin.core.valves.registry import complete_options, get_model, get_simulation

MODELS = ("press_cartridge", "positioner")


def main() -> None:
    """Compile everything."""
    for name in MODELS:
        for rule in CycleRule:
            run_once(name, rule)
    aging.warm_up()


def run_once(name: str, rule: CycleRule) -> None:
    """Run a short record of one valve through everything; a node does so before its first sample.

    Parameters
    ----------
    name : str
        Name of the model.
    rule : CycleRule
        Rule that cuts the record.

    Raises
    ------
    ValueError
        If the model is unknown or cannot be simulated.
    """
    model = get_model(name)
    simulation = get_simulation(name)
    options = complete_options(model, {})
    ranges = tuple(SignalRange(s) for s in (model.output, *model.inputs))
    config = TwinConfig(
        period_s=simulation.period_s,
        signals=ranges,
        counter=SignalRange("cycle_counter"),
        reference=SignalRange("reference"),
        cycles=CycleConfig(rule=rule, window_s=30.0),
        options=options,
    )
    twin = Twin(config, model)
    block = SimulatedValve(simulation, seed=0).advance(4 * simulation.cycle_samples)
    columns = dict(zip(model.inputs, block.inputs.T, strict=True))
    columns |= {"cycle_counter": block.cycle.astype(float), "reference": block.reference}
    columns |= {model.output: block.position}
    for signal, values in columns.items():
        twin.push(signal, block.stamp_ns, np.ascontiguousarray(values))
    while (job := twin.next_job()) is not None:
        twin.deliver(*estimate_cycle(model, options, job.cycle, job.memory))
    twin.finish()


if __name__ == "__main__":
    main()
