# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""When a command acts: its delay to a part of a sample, and the pole of what follows.

In a closed loop the command falls with the distance that is left, so a response that is a part of
a sample late looks like a larger gain. An integer lag left 1 to 5 % in K_out, whatever the noise.
One cycle shows the part of a sample only where its noise is low; the valve's own cycles before
show it together, and a cycle that does not contradict them takes it from them.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, nan
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.cycle.scatter_kernel import middle_of
from valve_twin.core.valves.press_cartridge.estimation.free_run import find_phases
from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import (
    N_COLUMNS,
    N_LINEAR,
    Rows,
    pole_likelihood,
    sample_flags,
)
from valve_twin.core.valves.press_cartridge.estimation.response.joint import Cycle, find_joint

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import BoolArray, Estimate, FloatArray
    from valve_twin.core.valves.press_cartridge.estimation.free_run import (
        OutputErrorOptions,
        Phases,
        Run,
    )

_USUAL = 0.15
"""Standard deviation of the part of a sample where nothing is known of the valve, assumed."""

_LEAST_POOLED = 5
"""Fewest cycles that are pooled."""

_MOST_POOLED = 20
"""So many of the last cycles are pooled: what changes is followed."""

_DECIDES = 12.0
"""A cycle decides for itself where its own timing is better by this, twice the log likelihood.

Three values are searched in a cycle by itself: chance gives 12 in one of 130, and what a free run
leaves is not white, so the share is larger."""


@dataclass(frozen=True, slots=True)
class Timing:
    """When a command acts.

    Attributes
    ----------
    delay : float
        Command to position delay [samples].
    pole : float
        Pole of the speed [1].
    pooled : bool
        Whether the cycles before say so.
    """

    delay: float
    pole: float
    pooled: bool = False


def find_timing(
    run: Run,
    lag: int,
    columns: BoolArray,
    options: OutputErrorOptions,
    phases: Phases | None = None,
) -> Timing:
    """Search delay and pole about a lag.

    Parameters
    ----------
    run : Run
        The cycle.
    lag : int
        Command to position lag about which the delay is searched [samples].
    columns : (5,) bool array
        Parameters that are fitted.
    options : OutputErrorOptions
        How the free run is fitted; a fixed pole and a fixed delay stay.
    phases : Phases, optional
        What the spool does at each sample, by the lag; found where omitted.
    """
    held = (phases or find_phases(run, lag, options)).stretch(run.position, run.use)
    fixed = options.delay >= 0.0
    cycle = Cycle(
        Rows(held.y, sample_flags(held), held.anchor, run.v_in, run.v_out),
        options.v_max,
        options.wander,
        columns,
        lag,
        0.0 if fixed else _USUAL,
        options.pole < 0.0,
    )
    part, pole = find_joint(cycle, options.pole)
    return Timing(lag + part, pole)


def timings_alone(earlier: Sequence[Estimate]) -> list[tuple[float, float]]:
    """Return delay [samples] and pole [1] that the last cycles found by themselves, oldest first.

    Those that are pooled; what is not known is passed over.

    Parameters
    ----------
    earlier : sequence of Estimate
        Of one estimator, oldest first.
    """
    found: list[tuple[float, float]] = []
    for estimate in reversed(earlier):
        values = {p.name: p.value for p in estimate.parameters}
        delay, pole = values.get("delay_alone", nan), values.get("pole_alone", nan)
        if isfinite(delay + pole):
            found.append((delay, pole))
        if len(found) == _MOST_POOLED:
            break
    return found[::-1]


def pool_timing(alone: Sequence[tuple[float, float]]) -> Timing | None:
    """Pool what single cycles found; None where they are too few.

    Parameters
    ----------
    alone : sequence of (float, float)
        Delay [samples] and pole [1] of each cycle by itself, oldest first; NaN = not known.
    """
    known = [(d, p) for d, p in alone if isfinite(d + p)][-_MOST_POOLED:]
    if len(known) < _LEAST_POOLED:
        return None
    delays, poles = np.array(known).T
    pole = float(middle_of(poles.copy()))
    total = float(middle_of(delays + poles / (1.0 - poles)))  # mean time to the speed [samples]
    return Timing(max(total - pole / (1.0 - pole), 0.0), pole, pooled=True)


@dataclass(frozen=True, slots=True)
class Timed:
    """A cycle by one timing.

    Attributes
    ----------
    timing : Timing
        When a command acts.
    phases : Phases
        What the spool does at each sample, by that delay.
    linear : (5,) array or None
        The linear parameters there [1], where they were fitted.
    """

    timing: Timing
    phases: Phases
    linear: FloatArray | None = None


def choose_timing(
    run: Run, own: Timing, pooled: Timing | None, columns: BoolArray, options: OutputErrorOptions
) -> Timed:
    """Return the pooled timing, or a cycle's own where the cycle contradicts it.

    Parameters
    ----------
    run : Run
        The cycle.
    own, pooled : Timing
        Of the cycle alone, and of those before.
    columns : (5,) bool array
        Parameters that are fitted.
    options : OutputErrorOptions
        How the free run is fitted.
    """
    if pooled is None or options.delay >= 0.0:
        return Timed(own, find_phases(run, own.delay, options))
    (alone, by_own), (together, by_pooled) = (
        _timed(run, t, columns, options) for t in (own, pooled)
    )
    return by_own if together - alone > _DECIDES else by_pooled


def _timed(
    run: Run, timing: Timing, columns: BoolArray, options: OutputErrorOptions
) -> tuple[float, Timed]:
    """Return minus twice the log likelihood, and the cycle by this timing."""
    p, gram = np.zeros(N_LINEAR), np.zeros((N_COLUMNS, N_COLUMNS))
    phases = find_phases(run, timing.delay, options)
    data, limits = phases.stretch(run.position, run.use), (options.v_max, options.wander, columns)
    value = pole_likelihood(data, *limits, timing.pole, p, gram)
    return value, Timed(timing, phases, p)
