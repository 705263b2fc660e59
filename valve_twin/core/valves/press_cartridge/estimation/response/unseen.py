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

from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import (
    N_COLUMNS,
    N_LINEAR,
    Rows,
    Stretch,
    sample_flags,
    solve_positive,
)
from valve_twin.core.valves.press_cartridge.estimation.response.lanes import (
    DELAY,
    POLE,
    SIZE,
    STILL,
    read_lane,
    run_lanes,
)
from valve_twin.core.valves.press_cartridge.estimation.response.weights import weigh_rows
from valve_twin.core.valves.press_cartridge.estimation.solvers.lanes import LANES
from valve_twin.kernels import njit

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

_DROWNED = 10.0
"""Noise in steps of the sensor at which no more than e^-1971 is left of a step, which is 0 [1]."""


def timing_spread(
    run: Run,
    phases: Phases,
    timing: Timing,
    columns: BoolArray,
    options: OutputErrorOptions,
    own: FloatArray | None = None,
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
    own : (5,) array, optional
        The linear parameters of the fit [1]; fitted where omitted.

    Returns
    -------
    (5, 5) array
        Mean products of the deviations, linear parameters of `output_error_kernel`.
    """
    center = _fits(run, phases, timing, np.zeros(1), columns, options)[1] if own is None else own
    freed = free_jumps(run, phases, options)
    shifts = np.array([shift for shift in _SHIFTS if timing.delay + shift >= 0.0])
    likelihoods, linear = _fits(run, freed, timing, shifts, columns, options)
    likelihoods += (shifts / _USUAL) ** 2
    weights = np.exp(-0.5 * (likelihoods - likelihoods.min()))
    deviations = linear - center
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
    jump, active = _JUMP * options.v_max, options.guard.active_command
    for v in (phases.v_in, phases.v_out):
        _free_jumps(run.position, phases.seated, v, jump, active, run.noise_sigma, leaving, anchor)
    return replace(phases, leaving=leaving, anchor=anchor)


@njit(cache=True)
def _free_jumps(
    position: FloatArray,
    seated: BoolArray,
    v: FloatArray,
    jump: float,
    active: float,
    noise_sigma: float,
    leaving: BoolArray,
    anchor: FloatArray,
) -> None:
    """Mark the samples behind each jump of a command off the seats, and free the level there."""
    moved = acted = 0.0
    for n in range(len(v)):
        if v[n] > active:
            moved += abs(position[n] - position[n - 1]) if n else 0.0
            acted += v[n]
    gain, last = moved / max(acted, 1e-9), len(v) - 1
    for n in range(1, len(v)):
        if leaving[n] or seated[n] or not abs(v[n] - v[n - 1]) > jump:
            continue
        end = min(n + 1, last)
        leaving[n:end] = True
        edge = _EDGE * gain * abs(v[end] - v[n - 1])
        known = (edge / noise_sigma) ** 2 if noise_sigma > 0.0 else np.inf
        anchor[end] = max(anchor[end], known)


def step_leak(run: Run, phases: Phases) -> float:
    """Return by how much steps of the sensor may shift the leak, half of an interval [1/sample].

    Parameters
    ----------
    run, phases : Run, Phases
        The cycle, and its phases at the fitted delay.
    """
    if not np.isfinite(run.noise_sigma) or run.noise_sigma > _DROWNED * _least_step(run.position):
        return 0.0  # the usual case, without sorting
    levels = np.unique(run.position)
    if len(levels) < 2:
        return 0.0
    step = float(np.diff(levels).min())
    noise = (run.noise_sigma / step) ** 2 - 1.0 / 12.0  # less that of rounding, in steps
    spread = np.exp(-2.0 * np.pi**2 * max(noise, 0.0))
    return float(step * spread / max(_longest(~phases.moving & phases.free), 1))


@njit(cache=True)
def _least_step(position: FloatArray) -> float:
    """Return the least step from one sample to the next other than 0; infinite without one."""
    least = np.inf
    for i in range(1, len(position)):
        step = abs(position[i] - position[i - 1])
        if 0.0 < step < least:
            least = step
    return least


def _longest(marks: BoolArray) -> int:
    """Return the length of the longest run of marks [samples]."""
    turns = np.flatnonzero(np.diff(marks.astype(np.int8), prepend=0, append=0))
    lengths = turns[1::2] - turns[::2]
    return int(lengths.max()) if len(lengths) else 0


def _fits(
    run: Run,
    phases: Phases,
    timing: Timing,
    shifts: FloatArray,
    columns: BoolArray,
    options: OutputErrorOptions,
) -> tuple[FloatArray, FloatArray]:
    """Return minus twice the log likelihood, (S,), and the linear parameters, (S, 5), by shift."""
    data, delays = phases.stretch(run.position, run.use), timing.delay + shifts
    v_max, wander = options.v_max, options.wander
    return _fit_each(data, run.v_in, run.v_out, delays, v_max, wander, columns, timing.pole)


@njit(cache=True)
def _fit_each(
    data: Stretch,
    v_in: FloatArray,
    v_out: FloatArray,
    delays: FloatArray,
    v_max: float,
    wander: float,
    columns: BoolArray,
    pole: float,
) -> tuple[FloatArray, FloatArray]:
    """Fit with the commands let act after each of the delays, eight at once."""
    likelihood, linear = np.empty(len(delays)), np.zeros((len(delays), N_LINEAR))
    gram, work = np.empty((N_COLUMNS, N_COLUMNS)), np.zeros(SIZE)
    rows = Rows(data.y, sample_flags(data), data.anchor, v_in, v_out)
    weighed = weigh_rows(rows, wander, delays.max())
    count = max(weighed.rows, 1)
    work[POLE : POLE + LANES] = pole
    for first in range(0, len(delays), LANES):
        for i in range(LANES):
            work[DELAY + i] = delays[min(first + i, len(delays) - 1)]
        run_lanes(weighed, v_max, STILL, work)
        for i in range(min(LANES, len(delays) - first)):
            read_lane(work, i, gram)
            cost = max(solve_positive(gram, columns, linear[first + i]), 1e-300)
            likelihood[first + i] = count * np.log(cost / count) + weighed.log_determinant
    return likelihood, linear
