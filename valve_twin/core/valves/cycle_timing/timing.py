# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""When a flow spike comes and how large the steady flow is, from one cycle of samples.

The spike rises within one or two samples, so an instant read from a threshold hangs on where the
samples happen to fall. The centroid uses every sample of the spike. It is taken over a window that
is centred on the centroid itself, samples at the edges counted in part, so that a later spike is
reported later by the same amount and the flow far from the spike does not pull.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.refusal import Refusal, RefusalCode

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, Cycle, FloatArray
    from valve_twin.core.valves.cycle_timing.parameters import CycleTimingOptions

_ITERATIONS = 200
_SETTLED = 1e-9  # share of the sampling time by which the centre still moves [1]
_LEAST_STEADY = 10  # fewest samples that make a mean flow, assumed


@dataclass(frozen=True, slots=True)
class Timing:
    """What a cycle shows; NaN and a reason where it shows nothing.

    Attributes
    ----------
    instant, rise, decay : float
        Centroid of the spike, centre of its rise, both from the first sample on; its decay [s].
    peak, steady : float
        Largest flow of the spike and mean flow of the steady window [unit of the flow].
    noise : float
        Standard deviation of the steady flow [unit of the flow].
    used : int
        Samples that carried weight.
    spike_refusal, steady_refusal : Refusal, optional
        Why there is no instant, or no steady flow.
    """

    instant: float = np.nan
    rise: float = np.nan
    decay: float = np.nan
    peak: float = np.nan
    steady: float = np.nan
    noise: float = np.nan
    used: int = 0
    spike_refusal: Refusal | None = None
    steady_refusal: Refusal | None = None


def find_timing(cycle: Cycle, options: CycleTimingOptions) -> Timing:
    """Measure the spike and the steady flow of one cycle.

    Parameters
    ----------
    cycle : Cycle
        One cycle of N >= 1 samples; the flow is its `position`.
    options : CycleTimingOptions
        The model's options.
    """
    frames, period = cycle.frames, cycle.period_s
    t = (frames.stamp_ns - frames.stamp_ns[0]) * 1e-9
    known = frames.valid & np.isfinite(frames.position)
    flow = np.where(known, frames.position, 0.0)
    start, end = options.steady_start_s, options.steady_end_s
    rests = known & (t >= start) & (t <= end)
    n_steady = int(np.count_nonzero(rests))
    steady_refusal = _few(n_steady, start, end, period)
    steady = noise = np.nan
    if not steady_refusal:
        steady, noise = float(flow[rests].mean()), float(flow[rests].std())
    found = _spike(t, flow, known, steady, period, options)
    if isinstance(found, Refusal):
        return Timing(
            steady=steady,
            noise=noise,
            used=n_steady * (not steady_refusal),
            spike_refusal=found,
            steady_refusal=steady_refusal,
        )
    instant, rise, peak, decay, n_spike = found
    return Timing(
        instant,
        rise,
        decay,
        peak,
        steady,
        noise,
        n_spike + n_steady * (not steady_refusal),
        None,
        steady_refusal,
    )


def self_centred(t: FloatArray, weight: FloatArray, start: float, half: float) -> float:
    """Return the fixed point of "centroid of the window around it" [s].

    Parameters
    ----------
    t, weight : (N,) arrays
        Sampling instants, evenly spaced [s], and weights, 0 or more.
    start : float
        Where the search begins [s].
    half : float
        Half width of the window [s].
    """
    period = float(t[1] - t[0])
    centre = start
    for _ in range(_ITERATIONS):
        inside = weight * np.clip((half - np.abs(t - centre)) / period + 0.5, 0.0, 1.0)
        total = float(inside.sum())
        if total <= 0.0:
            return centre
        before, centre = centre, float(np.sum(t * inside)) / total
        if abs(centre - before) <= _SETTLED * period:
            break
    return centre


def _spike(
    t: FloatArray,
    flow: FloatArray,
    known: BoolArray,
    steady: float,
    period: float,
    options: CycleTimingOptions,
) -> tuple[float, float, float, float, int] | Refusal:
    """Return instant, rise [s], peak [flow], decay [s] and samples used, or why there is none."""
    start, end = options.spike_start_s, options.spike_end_s
    half = options.spike_half_width_s
    begin = max(start - half, 0.0)  # nothing is known of what was before the cycle
    near = (t >= begin) & (t <= end + half)
    wanted = round((end + half - begin) / period)
    if int(np.count_nonzero(near & known)) < wanted or not known[near].all():
        text = f"the flow is not whole from {begin:g} to {end + half:g} s of the cycle"
        return Refusal(RefusalCode.GAPS, text)
    at, q = t[near], flow[near]
    searched = (at >= start) & (at <= end)
    top = int(np.argmax(np.where(searched, q, -np.inf)))
    peak, least = float(q[top]), options.min_spike_ratio
    floor = steady if np.isfinite(steady) else float(np.median(q))
    if not peak > least * max(floor, 0.0):
        text = f"no spike from {start:g} to {end:g} s: peak {peak:.4g}, steady flow {floor:.4g}"
        return Refusal(RefusalCode.NO_MOTION, text)
    instant = self_centred(at, np.maximum(q, 0.0), float(at[top]), half)
    if not start <= instant <= end:
        text = f"the spike lies at {instant:.3f} s, outside {start:g} to {end:g} s"
        return Refusal(RefusalCode.NOT_EXCITED, text)
    return instant, *_shape(at, q, top, floor, period), len(q)


def _shape(
    t: FloatArray, q: FloatArray, top: int, steady: float, period: float
) -> tuple[float, float, float]:
    """Return the centre of the rise [s], the peak [flow] and the decay of the spike [s]."""
    steps = np.maximum(np.diff(q[: top + 1], prepend=q[:1]), 0.0)
    rise = float(np.sum((t[: top + 1] - 0.5 * period) * steps) / max(steps.sum(), 1e-300))
    peak = float(q[top])
    above = np.maximum(q[top:] - steady, 0.0)
    samples = float(above.sum()) / max(peak - steady, 1e-300)  # 1 / (1 - exp(-period / decay))
    decay = -period / np.log1p(-1.0 / samples) if samples > 1.0 else 0.0
    return rise, peak, decay


def _few(count: int, start: float, end: float, period: float) -> Refusal | None:
    wanted = max(_LEAST_STEADY, round(0.5 * (end - start) / period))
    if count >= wanted:
        return None
    text = f"{count} samples of flow from {start:g} to {end:g} s, fewer than {wanted}"
    return Refusal(RefusalCode.FEW_SAMPLES, text)
