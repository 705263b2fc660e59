# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What runs in the worker process: one estimation at a time, nothing of ROS.

The node imports this, too, to name the jobs; what only they need is imported where they run. The
memory of 50 cycles is large; the worker keeps it between jobs and is sent it only when it
lacks it, so that the data path does not pack it every cycle.
"""

from __future__ import annotations

import sys
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.cycle.movement import find_moves
from valve_twin.core.valves.registry import get_model
from valve_twin.warmup import Compiled, compiled, predict_once, run_once

if TYPE_CHECKING:
    from collections.abc import Iterable

    from valve_twin.core.estimation.cycle.memory import Memory
    from valve_twin.core.types import Cycle, CycleRule, Estimate
    from valve_twin.core.valves.interface import Options

MEMORY_LACKS = None
"""Result of a job whose memory the worker does not hold: to be sent again with it."""

_kept: dict[str, tuple[int, Memory]] = {}


def run_job(
    valve: str, model: str, options: Options, cycle: Cycle, ordinal: int, memory: Memory | None
) -> tuple[Estimate, ...] | None:
    """Estimate one cycle.

    Parameters
    ----------
    valve, model : str
        Name of the valve and of its model.
    options : dataclass
        Options of the model.
    cycle : Cycle
        The cycle.
    ordinal : int
        Count of the valve's jobs; the memory after job n is kept for job n + 1.
    memory : Memory or None
        What the cycles before taught; None = as kept.

    Returns
    -------
    tuple of Estimate or None
        One an estimator; None (`MEMORY_LACKS`) where the memory is needed and not kept.
    """
    from valve_twin.core.estimation.cycle.sequence import estimate_cycle

    if memory is None:
        kept = _kept.get(valve)
        if kept is None or kept[0] != ordinal:
            return MEMORY_LACKS
        memory = kept[1]
    estimates, after = estimate_cycle(get_model(model), options, cycle, memory)
    _kept[valve] = (ordinal + 1, after)
    return estimates


def warm_up(valves: Iterable[tuple[str, CycleRule, Options]]) -> None:
    """Load what estimation needs before the first cycle is there: no cycle waits for an import.

    Parameters
    ----------
    valves : iterable of (str, CycleRule, mapping)
        Model, cycle rule and options of every valve.
    """
    with compiled() as found:
        for model, rule, options in valves:
            with suppress(Exception):  # a user's model may come without a simulation
                run_once(model, rule, options)
    if found.kernels:
        sys.stderr.write(f"estimation: {found}\n")


def warm_up_prediction(valves: Iterable[tuple[str, CycleRule, Options]]) -> Compiled:
    """Load what prediction alone needs before the first sample is there; as `warm_up`.

    Returns
    -------
    Compiled
        What had to be compiled for it.
    """
    with compiled() as found:
        find_moves(np.linspace(0.0, 1.0, 8))  # the counters, too, run beside the predictions
        for model, rule, _ in valves:
            with suppress(ValueError):  # a user's model may want other parameters
                predict_once(model, rule)
    return found
