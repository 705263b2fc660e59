# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What of a cycle a law can be fitted to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.data.masks import held_recently
from valve_twin.core.estimation.data.stale import find_stale
from valve_twin.core.gaps import find_gaps
from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.types import MaskCounts

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, Cycle, FloatArray, Frames


@dataclass(frozen=True, slots=True)
class Record:
    """The longest stretch of a cycle without a gap, from its first usable sample on.

    Attributes
    ----------
    output : (N,) array
        Measured output; the last usable value where one is not.
    inputs : (N, M) array
        Inputs, likewise.
    used : (N,) bool array
        Samples that carry weight: valid, finite and not repeated by the sensor.
    period_s : float
        Sampling time [s].
    counts : MaskCounts
        Samples of the cycle that are used and left out.
    """

    output: FloatArray
    inputs: FloatArray
    used: BoolArray
    period_s: float
    counts: MaskCounts


def held(values: FloatArray, known: BoolArray) -> FloatArray:
    """Repeat the last known value (N,) or row (N, M) over unknown ones, 0 before the first."""
    index = np.maximum.accumulate(np.where(known, np.arange(len(values)), 0))
    return np.ascontiguousarray(np.nan_to_num(values[index], nan=0.0, posinf=0.0, neginf=0.0))


def usable(frames: Frames, first_input: int = 0) -> BoolArray:
    """Return which samples (N,) are valid and finite, inputs before `first_input` left out."""
    known: BoolArray = frames.valid & np.isfinite(frames.position)
    return known & np.isfinite(frames.inputs[:, first_input:]).all(axis=1)


def whole_refusal(cycle: Cycle, known: BoolArray, least: int, why: str) -> str:
    """Return why a cycle is not whole, empty if it is.

    Parameters
    ----------
    cycle : Cycle
        N samples.
    known : (N,) bool array
        Samples that can be used.
    least : int
        How many have to be.
    why : str
        Why there must be no gap.
    """
    count = int(np.count_nonzero(known))
    if count < least:
        return Refusal(RefusalCode.FEW_SAMPLES, f"{count} usable samples, fewer than {least}")
    gaps = int(np.count_nonzero(find_gaps(cycle.frames.stamp_ns, cycle.period_s)))
    return Refusal(RefusalCode.GAPS, f"{gaps} gaps: {why}") if gaps else ""


def rest_refusal(what: str, values: FloatArray, least: float) -> str:
    """Return why values show no motion, empty if they do.

    Parameters
    ----------
    what : str
        What moved, with {} for how far.
    values : (N,) array
        At least one usable value [unit of the signal].
    least : float
        Option `min_motion`: how far they lie apart at least [unit of the signal].
    """
    span = float(np.ptp(values))
    if not span < least:
        return ""
    text = f"{what.format(f'{span:.3g}')}, less than min_motion {least:g}"
    return Refusal(RefusalCode.NO_MOTION, text)


def longest_stretch(frames: Frames, period_s: float) -> Frames:
    """Return the longest stretch without a gap of at least one sample, at a period [s]."""
    edges = np.concatenate(
        ([0], np.flatnonzero(find_gaps(frames.stamp_ns, period_s)), [len(frames)])
    )
    longest = int(np.argmax(np.diff(edges)))
    return frames[int(edges[longest]) : int(edges[longest + 1])]


def longest_whole(frames: Frames, period_s: float) -> tuple[Frames, BoolArray]:
    """Return the longest stretch without a gap, and which of its samples are usable.

    Parameters
    ----------
    frames : Frames
        At least one sample.
    period_s : float
        Sampling time [s].

    Returns
    -------
    Frames, (N,) bool array
        From the first usable sample on, where there is one; valid and finite samples.
    """
    part = longest_stretch(frames, period_s)
    known = usable(part)
    first = int(np.argmax(known))
    return part[first:], known[first:]


def take_record(cycle: Cycle, *, max_lag: int) -> Record:
    """Take what can be fitted out of a cycle.

    Parameters
    ----------
    cycle : Cycle
        At least one sample.
    max_lag : int
        Longest command to output lag [samples].
    """
    part, known = longest_whole(cycle.frames, cycle.period_s)
    output, inputs = held(part.position, known), held(part.inputs, known)
    stale = np.zeros(len(part), dtype=np.bool_)
    if known.all():
        changed = np.any(np.diff(inputs, axis=0, prepend=inputs[:1]) != 0.0, axis=1)
        breaks = np.zeros(len(part), dtype=np.bool_)
        active = held_recently(changed, 4 * max(max_lag, 1))
        stale = find_stale(output, active, breaks, max_lag=max_lag)[0]
    used = known & ~stale
    n_used, n_stale = int(np.count_nonzero(used)), int(np.count_nonzero(stale))
    counts = MaskCounts(n_used, stale=n_stale, bad=len(cycle.frames) - n_used - n_stale)
    return Record(output, inputs, used, cycle.period_s, counts)
