# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A channel that repeats itself without a command: strokes, load cycles of a rig."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.survey.choose import ANSWERS
from valve_twin.core.survey.cycles import CyclePlan
from valve_twin.core.types import CycleRule
from valve_twin.core.valves.registry import get_model, model_names

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.survey.pairs import Signal
    from valve_twin.core.types import FloatArray

_ALIKE = 0.5  # correlation of a record with itself a cycle later, assumed
_LEAST_CYCLES = 3
_FEWEST = 20  # samples of a cycle


@dataclass(frozen=True, slots=True)
class Repeat:
    """A channel that repeats.

    Attributes
    ----------
    channel : str
        Its name.
    cycle_s : float
        Length of a cycle [s].
    correlation : float
        With itself a cycle later [1].
    model : str
        A model that needs no command.
    options : mapping
        What the mean cycle says of its options.
    plan : CyclePlan
        Windows of that length.
    scale, offset : float
        What is followed is scale * channel + offset, in SI.
    command : str
        The channel that begins its cycles; "" = none.
    """

    channel: str
    cycle_s: float
    correlation: float
    model: str
    options: Mapping[str, object]
    plan: CyclePlan
    scale: float = 1.0
    offset: float = 0.0
    command: str = ""


def find_repeat(
    signals: Mapping[str, Signal],
    roles: Mapping[str, Sequence[str]],
    sizes: Mapping[str, float],
    *,
    position: str = "",
) -> Repeat | None:
    """Return the channel that repeats most clearly, None where none does.

    Parameters
    ----------
    signals : mapping
        Channels that change, by name; one that counts cycles gives their length.
    roles : mapping
        What each may be by its name.
    sizes : mapping
        What 1 of a channel is in SI.
    position : str
        The channel, where it is known.
    """
    lengths = {
        n for k, s in signals.items() if "count" in roles.get(k, ()) and (n := _counted(s.values))
    }
    best: tuple[float, str, int] | None = None
    for name, signal in signals.items():
        kind = (list(roles.get(name, ())) or [""])[0]
        if (position and name != position) or (kind and kind not in ANSWERS):
            continue
        values = signal.values - signal.values.mean()
        for n in lengths or _lengths(values):
            if len(values) < _LEAST_CYCLES * n:
                continue
            found = _alike(values, n), name, n
            if found[0] > _ALIKE and (best is None or found[0] > best[0]):
                best = found
    if best is None:
        return None
    correlation, name, n = best
    signal = signals[name]
    period_s = float(np.median(np.diff(signal.stamp_ns))) * 1e-9
    length = float(n) if lengths else _exact(signal.values, n)
    rows = int(len(signal.values) / length)
    starts = np.rint(length * np.arange(rows)).astype(np.int64)
    whole = [signal.values[at : at + n] for at in starts if at + n <= len(signal.values)]
    mean = np.mean(whole, axis=0)
    found_models = [m for m in model_names() if not get_model(m).inputs]
    if not found_models:
        return None
    options = get_model(found_models[0]).options_for(sizes[name] * mean, period_s)
    reason = (
        f"repeats every {length * period_s:.6g} s (correlation {correlation:.2f}), {rows} times"
    )
    plan = CyclePlan(CycleRule.WINDOW, reason, {"window_s": length * period_s})
    return Repeat(name, length * period_s, correlation, found_models[0], options, plan)


def _counted(values: FloatArray) -> int:
    """Return the samples of a cycle by a channel that counts cycles, 0 = none."""
    edges = np.flatnonzero(np.diff(values)) + 1
    if len(edges) < _LEAST_CYCLES - 1:
        return 0
    n = int(np.median(np.diff(edges)))
    return n if n >= _FEWEST else 0  # else it counts rows


def _alike(values: FloatArray, n: int) -> float:
    return float(np.corrcoef(values[:-n], values[n:])[0, 1])


def _exact(values: FloatArray, n: int) -> float:
    """Return the length of a cycle, over as many as the record holds [samples]."""
    later = values[n:]  # the first cycle may have begun before the record
    room = max(2, n // 20)
    near = range(max(1, n - room), min(n + room + 1, len(later) - n))
    length = float(max(near, key=lambda lag: _alike(later, lag), default=n))
    cycles = 2
    while cycles < len(later) // n:
        about = round(cycles * length)
        if about + 2 > len(later) - 2 * n:
            break
        near = range(about - 2, about + 3)
        best = max(near, key=lambda lag: _alike(later, lag))
        length = best / cycles
        cycles *= 2
    return length


def _lengths(values: FloatArray) -> list[int]:
    """Return the lag of the first great maximum of the autocorrelation behind its first zero."""
    n = 1 << (2 * len(values)).bit_length()
    power = np.abs(np.fft.rfft(values, n)) ** 2
    count = len(values)
    r = np.fft.irfft(power, n)[: count // 2] / (count - np.arange(count // 2))
    below = np.flatnonzero(r < 0.0)
    if not len(below) or len(r) <= below[0]:
        return []
    part = r[below[0] :] / r[0]
    high = np.flatnonzero(part > 0.9 * part.max())
    if not len(high):
        return []
    first = int(high[0])
    run = first + int(np.argmax(part[first : first + max(2, first // 10)]))
    lag = int(below[0]) + run
    return [lag] if lag >= _FEWEST else []
