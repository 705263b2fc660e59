# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Recognise signals that are short of samples or bits, late, early, or of another size.

Each check answers with one line as those of `plausibility` do.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.cycle.lag_kernels import explained_by_lag, steps_within

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import FloatArray, Frames

_MOST_LOST = 0.05  # share of the samples of a cycle that may be missing or outside limits, assumed
_FEWEST_LEVELS = 4  # of a position, to know its step
_STROKES = (0.6, 1.6)  # a cycle's stroke over the usual one, products differ, assumed
_REACH_S = 1.0  # how late or early a response is looked for [s]
_MOST_TRIED = 64  # lags on either side
_AS_WELL = 0.98  # share of what the best lag explains at which another is it as well, assumed
_AT_STOP = 0.05  # share of the span from its end at which a position is at a stop, assumed

COARSEST = 0.01
"""Step of a position that still tells a leak [share of the stroke]: 7 bits, assumed."""

WORSE = 0.9
"""Share of the best agreement that an allowed lag must reach [1], assumed."""

CLEAR = 0.08
"""Least correlation of commands and motion by which a lag can be told [1], assumed."""


def lost_fault(names: Sequence[str], frames: Frames) -> str:
    """Name the signal of which too many samples are no number, or say that too many are outside.

    Parameters
    ----------
    names : sequence of str
        The position, then the inputs in the order of the frames.
    frames : Frames
        At least one sample, one of them valid.
    """
    count = len(frames.position)
    for name, values in zip(names, (frames.position, *frames.inputs.T), strict=True):
        missing = 1.0 - np.count_nonzero(np.isfinite(values)) / count
        if missing > _MOST_LOST:
            return (
                f"{name} is no number in {missing:.0%} of the samples, {_MOST_LOST:.0%} are "
                f"allowed: correct the source of signals.{name}.topic"
            )
    outside = 1.0 - np.count_nonzero(frames.valid) / count
    if outside > _MOST_LOST:
        every = ", ".join(f"signals.{name}" for name in names)
        return (
            f"{outside:.0%} of the samples are outside the limits of their signals or too old, "
            f"{_MOST_LOST:.0%} are allowed: correct scale, offset, limits or hold of {every}"
        )
    return ""


def step_fault(name: str, position: FloatArray, span: float) -> str:
    """Name a position that moves in steps too coarse to tell a leak.

    Parameters
    ----------
    name : str
        Its name.
    position : (N,) array
        Finite positions [1].
    span : float
        Distance of the seats [1].
    """
    if steps_within(position, COARSEST * span):
        return ""  # the usual case, without sorting
    steps = np.diff(np.sort(position))
    steps = steps[steps > 0.0]
    if len(steps) < _FEWEST_LEVELS - 1:
        return ""
    step = float(steps.min())
    if step <= COARSEST * span:
        return ""
    return (
        f"{name} moves in steps of {step:.3g}, {COARSEST * span:.3g} is the coarsest that tells "
        f"a leak: read signals.{name}.topic with more bits"
    )


def stroke_fault(name: str, position: FloatArray, usual: float) -> str:
    """Name a position whose stroke is not what the configuration says of a usual cycle.

    Parameters
    ----------
    name : str
        Its name.
    position : (N,) array
        Finite positions [1].
    usual : float
        Stroke of a usual cycle [1]; 0 = not known.
    """
    if not usual > 0.0:
        return ""
    low, high = np.quantile(position, (0.01, 0.99))
    stroke = float(high - low)
    if _STROKES[0] * usual <= stroke <= _STROKES[1] * usual:
        return ""
    return (
        f"{name} runs through {stroke:.3g} in a cycle, usual_stroke is {usual:.3g}: correct "
        f"signals.{name}.scale, or usual_stroke where the product is another"
    )


def lags_tried(samples: int, period_s: float, max_lag: int) -> int:
    """Return how late or early a response is looked for in a cycle [samples].

    Parameters
    ----------
    samples : int
        Of the cycle [1].
    period_s : float
        Sampling time [s].
    max_lag : int
        Longest lag that a fit searches [samples].
    """
    return min(max(round(_REACH_S / period_s), 2 * max_lag), samples // 4, _MOST_TRIED)


def late_fault(
    name: str, position: FloatArray, inputs: FloatArray, *, period_s: float, max_lag: int
) -> str:
    """Tell whether a position answers its commands later than is searched, or before them.

    Parameters
    ----------
    name : str
        The position.
    position : (N,) array
        Position [1].
    inputs : (N, 2) array
        The command that raises it and the one that lowers it [1].
    period_s : float
        Sampling time [s].
    max_lag : int
        Longest lag that is searched [samples].
    """
    reach = lags_tried(len(position), period_s, max_lag)
    if reach <= max_lag:
        return ""
    agreement = explained_by_lag(position, inputs, reach)
    best = int(np.argmax(agreement))
    allowed = agreement[reach : reach + max_lag + 1].max()
    if not agreement[best] > CLEAR or allowed >= WORSE * agreement[best]:
        return ""
    beside = np.stack((position[:-2], position[1:-1], position[2:]))
    smooth = np.concatenate((position[:1], np.median(beside, axis=0), position[-1:]))
    at_stops = explained_by_lag(smooth, inputs, reach, _AT_STOP)  # a wild sample is no stop
    if at_stops[reach : reach + max_lag + 1].max() >= _AS_WELL * at_stops.max():
        return ""  # commands that press on against a stop spoke for another lag
    late = (best - reach) * period_s
    if late < 0.0:
        return (
            f"{name} moves {-late:.3g} s before its commands: its clock or that of the commands "
            f"is wrong: correct signals.{name}.topic or the stamps"
        )
    return (
        f"{name} moves {late:.3g} s after its commands, {max_lag * period_s:.3g} s are searched: "
        f"correct the stamps, or max_lag"
    )
