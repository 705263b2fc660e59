# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a cycle leaves open by the way it was recorded: time of the response, steps of the sensor.

A command that jumps does so at a moment inside a sample that no logger shows, and a pilot whose
rate is limited answers a jump later than what follows. Both decide the delay that is fitted, since
no other part of a cycle is as steep. With the level free behind each jump the rest of the motion
says how well it knows the time: the gains are averaged over it.

A position that moves in steps of q through a hold of N samples shows its leak to q/N a sample,
unless noise spreads it over several steps.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.press_cartridge.estimation.free_run import acting_command
from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import (
    N_COLUMNS,
    N_LINEAR,
    pole_likelihood,
)

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray
    from valve_twin.core.valves.press_cartridge.estimation.free_run import (
        OutputErrorOptions,
        Phases,
        Run,
    )
    from valve_twin.core.valves.press_cartridge.estimation.response.timing import Timing

_SHIFTS = (-0.6, -0.3, 0.0, 0.3, 0.6)
"""By how much later than fitted commands are let act [samples]."""

_USUAL = 0.5
"""Standard deviation of the shift where the cycle says nothing of it [samples], assumed."""

_JUMP = 0.15
"""Change of a command in a sample from which on it jumps, of the greatest command [1], assumed."""

_EDGE = 0.4
"""Standard deviation of when a jump acts [samples]: uniform within one sample, and the time that a
pilot takes to follow it, assumed."""


def timing_spread(
    run: Run, phases: Phases, timing: Timing, columns: BoolArray, options: OutputErrorOptions
) -> FloatArray:
    """Return how far the linear parameters lie from the fit, on the average over the time: (5, 5).

    Parameters
    ----------
    run, phases : Run, Phases
        The cycle, and its phases at the fitted delay.
    timing : Timing
        As fitted.
    columns : (5,) bool array
        Parameters that are fitted.
    options : OutputErrorOptions
        How the free run is fitted.

    Returns
    -------
    (5, 5) array
        Mean products of the deviations, linear parameters of `output_error_kernel`.
    """
    center = _fit(run, phases, timing, 0.0, columns, options)[1]
    freed = free_jumps(run, phases, options)
    likelihoods, off = [], []
    for shift in _SHIFTS:
        if timing.delay + shift >= 0.0:
            likelihood, linear = _fit(run, freed, timing, shift, columns, options)
            likelihoods.append(likelihood + (shift / _USUAL) ** 2)
            off.append(linear - center)
    weights = np.exp(-0.5 * (np.array(likelihoods) - min(likelihoods)))
    deviations = np.array(off)
    spread: FloatArray = (deviations.T * (weights / weights.sum())) @ deviations
    return spread


def free_jumps(run: Run, phases: Phases, options: OutputErrorOptions) -> Phases:
    """Return the phases with the level less known behind each jump of a command off the seats.

    Parameters
    ----------
    run, phases, options : Run, Phases, OutputErrorOptions
        The cycle, its phases, and how the free run is fitted.
    """
    leaving, anchor = phases.leaving.copy(), phases.anchor.copy()
    last = len(anchor) - 1
    moved = np.abs(np.diff(run.position, prepend=run.position[:1]))
    for v in (phases.v_in, phases.v_out):
        jumps = np.abs(np.diff(v, prepend=v[:1])) > _JUMP * options.v_max
        on = v > options.guard.active_command
        gain = float(moved[on].sum()) / max(float(v[on].sum()), 1e-9)
        for first in np.flatnonzero(jumps & ~leaving & ~phases.seated).tolist():
            end = min(first + 1, last)
            leaving[first:end] = True
            edge = _EDGE * gain * abs(float(v[end] - v[first - 1]))
            known = (edge / run.noise_sigma) ** 2 if run.noise_sigma > 0.0 else np.inf
            anchor[end] = max(anchor[end], known)
    return replace(phases, leaving=leaving, anchor=anchor)


def step_leak(run: Run, phases: Phases) -> float:
    """Return by how much steps of the sensor may shift the leak, half of an interval [1/sample].

    Parameters
    ----------
    run, phases : Run, Phases
        The cycle, and its phases at the fitted delay.
    """
    levels = np.unique(run.position)
    if len(levels) < 2 or not np.isfinite(run.noise_sigma):
        return 0.0
    step = float(np.diff(levels).min())
    noise = (run.noise_sigma / step) ** 2 - 1.0 / 12.0  # less that of rounding, in steps
    spread = np.exp(-2.0 * np.pi**2 * max(noise, 0.0))
    return float(step * spread / max(_longest(~phases.moving & phases.free), 1))


def _longest(marks: BoolArray) -> int:
    """Return the length of the longest run of marks [samples]."""
    turns = np.flatnonzero(np.diff(marks.astype(np.int8), prepend=0, append=0))
    lengths = turns[1::2] - turns[::2]
    return int(lengths.max()) if len(lengths) else 0


def _fit(
    run: Run,
    phases: Phases,
    timing: Timing,
    shift: float,
    columns: BoolArray,
    options: OutputErrorOptions,
) -> tuple[float, FloatArray]:
    """Return minus twice the log likelihood, and the linear parameters, (5,)."""
    acting = [acting_command(v, timing.delay + shift) for v in (run.v_in, run.v_out)]
    data = phases.stretch(run.position, run.use)._replace(v_in=acting[0], v_out=acting[1])
    p, gram = np.zeros(N_LINEAR), np.zeros((N_COLUMNS, N_COLUMNS))
    pole, v_max, wander = timing.pole, options.v_max, options.wander
    return pole_likelihood(data, v_max, wander, columns, pole, p, gram), p
