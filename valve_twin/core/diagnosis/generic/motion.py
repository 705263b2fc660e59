# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A valve's own motion in few numbers: what its signatures are derived from.

The free run of the reference model under the commands of a cycle, thinned to the samples between
which a monotone cubic gives the others, with noise and rounding of the sensor. It travels with
the features of one cycle in some tens, so that what is found stays a function of what is stored.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.features import ESTIMATOR, MOTION, NOISE
from valve_twin.core.diagnosis.generic.features import span_of, step_of
from valve_twin.core.types import Parameter, ParameterValue

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from valve_twin.core.diagnosis.generic.features import Record
    from valve_twin.core.types import Estimate, FloatArray

_MOST = 48
"""Most samples that are kept of a cycle."""

_NEAR = 5e-4
"""Share of the span within which those between need not be kept, assumed [1]."""

_LEAST_NOISE = 0.2
"""Noise of a sensor that rounds, over its step, at least: rounding hides what is less [1]."""

_GOOD_SENSOR = 1e-4
"""Least noise of a position, of which less was interpolated or filtered away: faults of a size
that no sensor sees have no signature; share of the span, assumed [1]."""

PARAMETERS = (
    Parameter(f"{MOTION}period_s", "s", "the valve's own motion: sampling time", 0.0),
    Parameter(f"{MOTION}noise", "1", "the same: noise of the position, share of the span", 0.0),
    Parameter(f"{MOTION}step", "1", "the same: step of the position, share of the span", 0.0),
    *(
        Parameter(f"{MOTION}{what}_{n:02d}", "1", f"the same: {text} that is kept")
        for n in range(_MOST)
        for what, text in (("at", "sample"), ("to", "position over the span"))
    ),
)
"""What a motion is made of."""


@dataclass(frozen=True, slots=True)
class Motion:
    """A motion that a valve makes in a cycle; hashable.

    Attributes
    ----------
    period_s : float
        Sampling time [s].
    noise, step : float
        Noise and rounding of the position, over the span [1].
    at, to : tuple of float
        Kept samples [1] and the positions there, over the span [1].
    """

    period_s: float
    noise: float
    step: float
    at: tuple[float, ...]
    to: tuple[float, ...]

    @property
    def sigma(self) -> float:
        """Noise of what is measured before it is rounded [1]."""
        return max(self.noise, _LEAST_NOISE * self.step, _GOOD_SENSOR)

    def positions(self) -> FloatArray:
        """Return the position at each sample over the span, (N,) [1]."""
        return _between(np.array(self.at), np.array(self.to), np.arange(self.at[-1] + 1.0))

    def values(self) -> list[ParameterValue]:
        """Return it as parameters of an estimate."""
        pairs = (x for pair in zip(self.at, self.to, strict=True) for x in pair)
        numbers = (self.period_s, self.noise, self.step, *pairs)
        return [ParameterValue(p.name, v) for p, v in zip(PARAMETERS, numbers, strict=False)]


def numbers_of(estimate: Estimate) -> tuple[float, ...]:
    """Return the numbers of the motion that features hold behind all else, in their order."""
    values = estimate.parameters
    if estimate.estimator != ESTIMATOR or not values or not values[-1].name.startswith(MOTION):
        return ()
    return tuple(p.value for p in values if p.name.startswith(MOTION))


def motion_from(numbers: Sequence[float]) -> Motion:
    """Return the motion that is made of some numbers."""
    period_s, noise, step, *pairs = numbers
    return Motion(period_s, noise, step, tuple(pairs[::2]), tuple(pairs[1::2]))


def motion_of(record: Record, found: Iterable[ParameterValue]) -> Motion | None:
    """Return the motion of a cycle; None where it shows none.

    Parameters
    ----------
    record : Record
        Measured and expected.
    found : iterable of ParameterValue
        Its features.
    """
    noise = next((p.value for p in found if p.name == NOISE and p.usable), np.nan)
    known = record.known
    response, span = record.response[known], span_of(record)
    if not (span > 0.0 and np.isfinite(noise)):
        return None
    at, unit = _kept(response / span), span if math.isnan(record.span) else record.span
    step = step_of(record.position[known]) / unit
    to = tuple(float(x) for x in response[at] / unit)
    return Motion(record.period_s, noise, step, tuple(map(float, at)), to)


def _kept(s: FloatArray) -> list[int]:
    """Return the samples to keep: one by one where those before miss most."""
    kept, t = [0, len(s) - 1], np.arange(float(len(s)))
    while len(kept) < min(_MOST, len(s)):
        at = np.array(sorted(kept))
        off = np.abs(_between(t[at], s[at], t) - s)
        worst = int(np.argmax(off))
        if off[worst] < _NEAR:
            break
        kept.append(worst)
    return sorted(kept)


def _between(at: FloatArray, to: FloatArray, t: FloatArray) -> FloatArray:
    from scipy.interpolate import PchipInterpolator  # slow to import

    return np.asarray(PchipInterpolator(at, to)(t), dtype=np.float64)
