# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which dimensions the signals of a valve tell apart, from one cycle of its simulation."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.quantity import replaced
from valve_twin.core.refusal import Refusal
from valve_twin.core.simulation.block import to_frames
from valve_twin.core.simulation.valve import SimulatedValve
from valve_twin.core.valves.designed import Apart
from valve_twin.core.valves.double_solenoid.dimensions.fit import fit_dimensions
from valve_twin.core.valves.double_solenoid.dimensions.judge import UNLIKE, leftovers
from valve_twin.core.valves.double_solenoid.dimensions.published import causes_of
from valve_twin.core.valves.double_solenoid.dimensions.table import DimensionTable
from valve_twin.core.valves.double_solenoid.numbers import DoubleSolenoidNumbers
from valve_twin.core.valves.double_solenoid.plant import DoubleSolenoidPlant, default_simulation
from valve_twin.core.valves.double_solenoid.record import make_record

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.designed import Numbers, Wear

_CYCLE = 2  # the first one begins at rest


def tell_apart(numbers: Numbers, wear: Sequence[Wear]) -> Apart:
    """Return which causes leave enough of each other; see `Designable.told_apart`.

    Parameters
    ----------
    numbers : Numbers
        Of the valve.
    wear : sequence of Wear
        What may drift.

    Raises
    ------
    ValueError
        If the simulated cycle shows no motion off the stops.
    """
    plant = replaced(DoubleSolenoidPlant(), {**numbers.shared, **numbers.own})
    config = replace(default_simulation(), plant=plant)
    running = SimulatedValve(config, 1)
    for _ in range(_CYCLE):
        frames = to_frames(running.advance(config.cycle_samples))
    known = {f.name: getattr(plant, f.name) for f in fields(DoubleSolenoidNumbers)}
    valve = DoubleSolenoidPlant(**known)
    usable = np.ones(len(frames), dtype=np.bool_)
    record = make_record(frames, usable, config.period_s, valve)
    table = DimensionTable(tuple(w.name for w in wear), tuple(w.change for w in wear))
    start = np.array([plant.force_gain, plant.friction, plant.preload_1])
    fit = fit_dimensions(record, valve.valve(), valve.tables(), table, start)
    if isinstance(fit, Refusal):
        message = f"the simulated cycle tells no dimension: {fit}"
        raise ValueError(message)
    causes = causes_of(table.names)
    leaves = leftovers(fit.covariance, causes)
    names = tuple(c.name for c in causes)
    return Apart(names, leaves, _groups(names, leaves))


def _groups(names: tuple[str, ...], leaves: FloatArray) -> tuple[tuple[str, ...], ...]:
    """Return the causes that are linked by pairs which leave less than is unlike anyway."""
    near = np.minimum(leaves, leaves.T) < UNLIKE**2
    label = np.arange(len(names))
    for _ in names:
        for i in range(len(names)):
            label[i] = label[near[i] | (np.arange(len(names)) == i)].min()
    groups = (tuple(n for n, k in zip(names, label, strict=True) if k == g)
              for g in dict.fromkeys(label.tolist()))  # fmt: skip
    return tuple(g for g in groups if len(g) > 1)
