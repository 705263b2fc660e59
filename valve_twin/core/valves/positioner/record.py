# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Take what can be fitted out of a cycle."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.data.masks import MaskOptions, find_masks
from valve_twin.core.estimation.data.noise import rest_noise
from valve_twin.core.gaps import find_gaps
from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.types import MaskCounts
from valve_twin.core.valves.kit.record import held, rest_refusal
from valve_twin.core.valves.positioner.fit import Record
from valve_twin.core.valves.positioner.kernels import MAX_LAG

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, Cycle, FloatArray, Frames
    from valve_twin.core.valves.positioner.parameters import PositionerOptions

_LEAST_BEYOND_LAG = 20  # fewest samples beyond the longest delay that a fit needs, assumed
_SETTLE_SAMPLES = 15  # samples beyond the longest delay until the position rests, assumed


@dataclass(frozen=True, slots=True)
class Prepared:
    """A cycle made ready.

    Attributes
    ----------
    record : Record
        The longest stretch without a gap in which the position moves.
    max_lag : int
        Longest delay to try [samples].
    counts : MaskCounts
        Samples used and left out.
    noise_sigma : float
        Position noise where the command rests [1]; NaN without rest.
    refusal : str
        Why the cycle cannot be fitted, empty if it can.
    """

    record: Record
    max_lag: int
    counts: MaskCounts
    noise_sigma: float
    refusal: str


def prepare(cycle: Cycle, options: PositionerOptions) -> Prepared:
    """Find the stretch to fit, what to leave out of it, and whether it says anything.

    The free run goes on over a sample that is left out; a stale one repeats an old value, so its
    position is missing.

    Parameters
    ----------
    cycle : Cycle
        At least one sample.
    options : PositionerOptions
        The model's options.
    """
    max_lag = _max_lag(options, cycle.period_s)
    part = _longest_whole(cycle.frames, cycle.period_s, options.min_motion)
    bad = ~part.valid | ~np.isfinite(part.position)
    command = held(part.inputs[:, 0], np.isfinite(part.inputs[:, 0]))
    position = held(part.position, ~bad)
    stale, sigma = _sensor(part, command, position, cycle.period_s, max_lag, options)
    used = ~bad & ~stale
    stops = np.array([options.lower_stop, options.upper_stop])
    record = Record(position, command, used, cycle.period_s, stops)
    n_stale = int(np.count_nonzero(stale))
    n_used = int(np.count_nonzero(used))
    counts = MaskCounts(n_used, stale=n_stale, bad=len(cycle.frames) - n_used - n_stale)
    return Prepared(record, max_lag, counts, sigma, _refusal(record, max_lag, options))


def _max_lag(options: PositionerOptions, period_s: float) -> int:
    return min(max(1, round(options.max_delay_s / period_s)), MAX_LAG)


def _longest_whole(frames: Frames, period_s: float, min_motion: float) -> Frames:
    """Return the longest stretch without a gap in which the position moves, if there is one.

    It starts with its first usable sample. A rest before the next recording may be longer.
    """
    gaps = find_gaps(frames.stamp_ns, period_s)
    edges = np.concatenate(([0], np.flatnonzero(gaps), [len(frames)]))
    lengths = np.diff(edges)
    moves = [_span(frames[int(a) : int(b)]) >= min_motion for a, b in pairwise(edges)]
    longest = int(np.argmax(np.where(moves, lengths, 0) if any(moves) else lengths))
    part = frames[int(edges[longest]) : int(edges[longest + 1])]
    known = part.valid & np.isfinite(part.position)
    return part[int(np.argmax(known)) :]


def _span(frames: Frames) -> float:
    """Return how far the usable positions of a stretch lie apart [1]."""
    usable = frames.position[frames.valid & np.isfinite(frames.position)]
    return float(np.ptp(usable)) if len(usable) else 0.0


def _sensor(
    part: Frames,
    command: FloatArray,
    position: FloatArray,
    period_s: float,
    max_lag: int,
    options: PositionerOptions,
) -> tuple[BoolArray, float]:
    """Return stale samples (N,) and the noise at rest [1].

    What drives a positioner is the distance to its command; it rests where the command does.
    """
    limits = MaskOptions(
        lower_stop=options.lower_stop, upper_stop=options.upper_stop, max_lag=max_lag
    )
    driven = replace(part, inputs=(command - position).reshape(-1, 1))
    masks = find_masks(driven, period_s, push=(1.0,), options=limits)
    steps = np.abs(np.diff(command, prepend=command[:1]))
    commanded = replace(part, inputs=steps.reshape(-1, 1))
    settle = max_lag + _SETTLE_SAMPLES
    noise = rest_noise(commanded, masks, active_command=0.0, settle=settle)
    return masks.stale, noise.sigma


def _refusal(record: Record, max_lag: int, options: PositionerOptions) -> str:
    n = int(np.count_nonzero(record.used))
    least = max_lag + _LEAST_BEYOND_LAG
    if n < least:
        text = f"{n} usable samples without a gap, fewer than the {least} a fit needs"
        return Refusal(RefusalCode.FEW_SAMPLES, text)
    position = record.position[record.used]
    rests = rest_refusal("the position moved by {} of the stroke", position, options.min_motion)
    if rests:
        return rests
    if float(np.ptp(record.command)) == 0.0:
        text = f"the command stayed at {record.command[0]:.3g}: the cycle excites nothing"
        return Refusal(RefusalCode.NOT_EXCITED, text)
    return ""
