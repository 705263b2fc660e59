# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How a valve answers the steps of its command that production makes, each with its doubt.

Levels are means of rests, times are crossings of a polynomial through the samples near a level:
all are functions of the motion without noise, so that the interval has something to cover. Times
begin with the first sample that carries the new command. Whether it came just then or up to a
sample before, the samples do not tell: the interval covers both (`interval_after`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.estimation.data.robust import NORMAL_975, difference_sigma
from valve_twin.core.operation.command_steps import Hold, Transition, find_transitions
from valve_twin.core.operation.step_interval import interval_after
from valve_twin.core.operation.way import LEAST_SAMPLES, LEFT_SIGMAS, end_of, smooth_way

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from valve_twin.core.types import Cycle, FloatArray

METRICS = {
    "dead_time": "s",
    "t63": "s",
    "t86": "s",
    "overshoot": "1",
    "travel_gain": "1",
    "breakaway": "s",
}
"""Unit by name; the gain is in units of the position by those of the command."""

LEAST_TRAVEL = 20.0
"""Least travel whose course is measured [standard deviations of the noise at rest], assumed."""

DRIFT, DRIFT_SIGMAS = 0.01, 4.0
"""Change between the halves of the end of a rest that is none [travels], [its own standard
errors]; the greater counts, assumed."""

HUNTS = 2.0
"""Scatter at rest that is no white noise [that of the differences], assumed."""

LEAST_FLANK = 4
"""Least samples near a level that tell when it is passed [1], assumed."""

MOST_STEPS = 20
"""Steps of a cycle that are measured; later ones are left out [1], assumed."""

_LEVELS = {5: 0.04, 10: 0.08, 30: 0.12, 63: 0.12, 86: 0.09}  # [%]: way to both sides [1]
_NARROWER = (1 / 4, 1 / 3, 1 / 2, 2 / 3)  # shares of them that are tried, the least first
_MANY, _NOISY = 9, 15.0  # samples and standard deviations of way that are enough
_CONVERGED = 1e-12  # change of a crossing that is none [half its window]
_MISFIT = 2.5  # scatter about a fit that is none of the noise [its variance]
_WIDEST = 0.25  # standard error of a crossing beyond which it is none [its window]
_PEAK, _PEAK_SIGMAS = 0.6, 3.0  # rim of a peak [its height]; least height [standard deviations]
_TOPS = np.vander(np.linspace(-1.0, 1.0, 201), 5, increasing=True)  # where a peak is looked for
_REPEATED = 0.2  # share of repeated values on the flank of a sensor that is too slow


@dataclass(frozen=True, slots=True)
class Metric:
    """One metric of one step.

    Attributes
    ----------
    name : str
        One of `METRICS`.
    value, lower_95, upper_95 : float
        Value and its interval [unit of `METRICS`]; NaN = refused.
    reason : str
        Why it is refused; empty = it is not.
    """

    name: str
    value: float = math.nan
    lower_95: float = math.nan
    upper_95: float = math.nan
    reason: str = ""


@dataclass(frozen=True, slots=True)
class StepMetrics:
    """What one step of a command tells.

    Attributes
    ----------
    cycle, step : int
        Number of the cycle, and of the step within it from 1.
    stamp_ns : int
        First sample that carries the new command [ns].
    command : str
        Signal that stepped.
    size : float
        Change of the command [its unit].
    metrics : tuple of Metric
        In the order of `METRICS`.
    """

    cycle: int
    step: int
    stamp_ns: int
    command: str
    size: float
    metrics: tuple[Metric, ...]


class _Rest(NamedTuple):
    """End of a hold: samples, mean, change between its halves and about its line."""

    samples: int
    level: float
    drift: float
    squares: float
    bends: FloatArray


class _Noise(NamedTuple):
    """Noise of a cycle at rest: standard deviation, that of the differences, least step."""

    sigma: float
    white: float
    quantum: float

    def level_variance(self, samples: int) -> float:
        """Return the variance of the mean of so many samples [unit of the position squared]."""
        return self.sigma**2 / samples + self.quantum**2 / 12.0


class _Crossing(NamedTuple):
    """When a level is passed [s], variance of it by the noise there [s^2], speed [1/s]."""

    time: float
    variance: float
    speed: float
    level: float


def measure_steps(cycle: Cycle, inputs: Sequence[str]) -> tuple[StepMetrics, ...]:
    """Measure every step of the commands of a cycle, `MOST_STEPS` at most.

    Parameters
    ----------
    cycle : Cycle
        Its samples.
    inputs : sequence of str
        Names of the commands, in the order of the columns of `Frames.inputs`.

    Returns
    -------
    tuple of StepMetrics
        In the order of time; empty where no command steps.
    """
    frames = cycle.frames
    good = frames.valid & np.isfinite(frames.position) & np.isfinite(frames.inputs).all(axis=1)
    if good.sum() < 2 * LEAST_SAMPLES:
        return ()
    stamp_ns, position = frames.stamp_ns[good], frames.position[good]
    found = find_transitions(frames.inputs[good])[:MOST_STEPS]
    if not found:
        return ()
    time_s = 1e-9 * (stamp_ns - stamp_ns[0])
    rests = {hold: _rest(position[hold.begin : hold.end]) for hold in _holds(found)}
    noise = _noise([r for r in rests.values() if r is not None], position)
    out = []
    for number, step in enumerate(found, 1):
        metrics = _measure(time_s, position, step, (rests[step.before], rests[step.after]), noise)
        name, begin_ns = inputs[step.column], int(stamp_ns[step.at])
        out.append(StepMetrics(cycle.number, number, begin_ns, name, step.size, metrics))
    return tuple(out)


def worth_telling(found: Iterable[StepMetrics]) -> list[StepMetrics]:
    """Return the steps that tell something, and the first of each command's that tell nothing.

    Parameters
    ----------
    found : iterable of StepMetrics
        Of one cycle.
    """
    silent: set[str] = set()
    kept = []
    for step in found:
        tells = any(math.isfinite(m.value) for m in step.metrics)
        if tells or step.command not in silent:
            kept.append(step)
        if not tells:
            silent.add(step.command)
    return kept


def _holds(found: Sequence[Transition]) -> dict[Hold, None]:
    return dict.fromkeys(hold for step in found for hold in (step.before, step.after))


def _rest(position: FloatArray) -> _Rest | None:
    """Return the end of a hold; None where it is too short."""
    if len(position) < LEAST_SAMPLES:
        return None
    end = end_of(position, LEAST_SAMPLES)
    n = len(end)
    at = np.arange(n) - 0.5 * (n - 1)
    level = float(end.mean())
    off = end - level
    off = off - at * (float(at @ off) / float(at @ at))
    drift = float(end[n // 2 :].mean() - end[: n // 2].mean())
    return _Rest(n, level, drift, float(off @ off), np.diff(end, 2))


def _noise(rests: Sequence[_Rest], position: FloatArray) -> _Noise:
    """Return the noise of all rests; a quantum that is finer than the noise does not count."""
    if not rests:
        return _Noise(math.nan, math.nan, math.nan)
    white = difference_sigma(np.concatenate([r.bends for r in rests]), 2)
    freedom = sum(r.samples - 2 for r in rests)
    still = [r for r in rests if r.squares <= (HUNTS * white) ** 2 * (r.samples - 2)] or rests
    sigma = math.sqrt(sum(r.squares for r in still) / sum(r.samples - 2 for r in still))
    steps = np.abs(np.diff(position))
    quantum = float(steps[steps > 0.0].min(initial=math.inf))
    if not sigma < quantum < math.inf:
        quantum = 0.0
    small = 1.0 + (NORMAL_975**2 + 1.0) / (4.0 * freedom)  # Student's t by that of the normal
    return _Noise(max(sigma, quantum / math.sqrt(12.0)) * small, white, quantum)


def _measure(
    time_s: FloatArray,
    position: FloatArray,
    step: Transition,
    rests: tuple[_Rest | None, _Rest | None],
    noise: _Noise,
) -> tuple[Metric, ...]:
    """Return the metrics of one step, each with its interval or its reason."""
    before, after = rests
    refused = _refusal(step, rests, noise)
    if refused or before is None or after is None:
        return tuple(Metric(name, reason=refused) for name in METRICS)
    travel = after.level - before.level
    variances = noise.level_variance(before.samples), noise.level_variance(after.samples)
    found = {"travel_gain": _gain(travel, step.size, variances)}
    unknown = _unknown_course(position, step, travel, noise)
    if not unknown:
        way = (position - before.level) / travel
        seen = slice(max(step.at - LEAST_SAMPLES, 0), step.after.end)
        course = _Course(
            time_s[seen] - time_s[step.at],
            way[seen],
            smooth_way(way[seen]),
            noise.sigma / abs(travel),
            (variances[0] / travel**2, variances[1] / travel**2),
            float(time_s[step.at] - time_s[step.at - 1]),
        )
        found |= course.metrics()
    return tuple(found.get(name, Metric(name, reason=unknown)) for name in METRICS)


def _refusal(step: Transition, rests: tuple[_Rest | None, _Rest | None], noise: _Noise) -> str:
    """Return why a step tells nothing, empty where it does."""
    before, after = rests
    if step.reason:
        return step.reason
    if before is None:
        return f"{step.before.samples} samples at rest before it, needed are {LEAST_SAMPLES}"
    if after is None or step.after.samples < 2 * LEAST_SAMPLES:
        text = f"not settled: {step.after.samples} samples until the next step or the end"
        return f"{text}, needed are {2 * LEAST_SAMPLES}"
    travel = abs(after.level - before.level)
    for rest, where in ((before, "before the step"), (after, "before the next step or the end")):
        drift = abs(rest.drift)
        if drift > max(DRIFT * travel, DRIFT_SIGMAS * 2.0 * noise.sigma / math.sqrt(rest.samples)):
            return f"not settled {where}: it still moves, by {drift:.3g} in its rest"
        scatter = math.sqrt(rest.squares / (rest.samples - 2))
        if scatter > max(HUNTS * noise.white, DRIFT * travel, noise.quantum):
            return f"not settled {where}: it hunts, standard deviation {scatter:.3g}"
    return ""


def _unknown_course(position: FloatArray, step: Transition, travel: float, noise: _Noise) -> str:
    """Return why times and overshoot are not told, empty where they can be."""
    least = LEAST_TRAVEL * noise.sigma
    if abs(travel) <= least:
        return f"the step is too small beside the noise: {abs(travel):.3g}, needed are {least:.3g}"
    if travel * step.size < 0.0:
        return "the position moves against the command"
    move = position[step.at : step.after.end]
    part = np.abs(move - move[0]) / abs(travel)
    flank = move[(part > 0.1) & (part < 0.9)]
    same = int((np.diff(flank) == 0.0).sum())
    if not noise.quantum and same > _REPEATED * len(flank):
        return f"the sampling is too coarse: the sensor repeats {same} of {len(flank)} values"
    return ""


def _gain(travel: float, size: float, variances: tuple[float, float]) -> Metric:
    value, half = travel / size, NORMAL_975 * math.sqrt(sum(variances)) / abs(size)
    return Metric("travel_gain", value, value - half, value + half)


class _Course(NamedTuple):
    """The way of one step and its noise.

    Attributes
    ----------
    time, way, smooth : (N,) arrays
        Since the step [s], way and its moving median [travels].
    noise : float
        Standard deviation of the way [1].
    levels : (float, float)
        Variances of its two levels [1].
    unseen_s : float
        Time before the first sample of the command in which it may have come [s].
    """

    time: FloatArray
    way: FloatArray
    smooth: FloatArray
    noise: float
    levels: tuple[float, float]
    unseen_s: float

    def metrics(self) -> dict[str, Metric]:
        """Return times and overshoot by name."""
        found = {level: self.crossing(level) for level in _LEVELS}
        times = {
            "dead_time": {10: 1.5, 30: -0.5},
            "t63": {63: 1.0},
            "t86": {86: 1.0},
            "breakaway": {5: 1.0},
        }
        out = {name: self.timed(name, weights, found) for name, weights in times.items()}
        return {**out, "overshoot": self.overshoot()}

    def timed(
        self, name: str, weights: dict[int, float], found: dict[int, _Crossing | str]
    ) -> Metric:
        """Return the weighted sum of crossings, with its interval."""
        value = variance = start = end = 0.0
        for level, weight in weights.items():
            crossing = found[level]
            if isinstance(crossing, str):
                return Metric(name, reason=crossing)
            value += weight * crossing.time
            variance += weight**2 * crossing.variance
            start += weight * (1.0 - crossing.level) / crossing.speed
            end += weight * crossing.level / crossing.speed
        variance += start**2 * self.levels[0] + end**2 * self.levels[1]
        lower, upper = interval_after(math.sqrt(variance), self.unseen_s)
        return Metric(name, value, value + lower, value + upper)

    def crossing(self, percent: int) -> _Crossing | str:
        """Return when a level is passed for the first time, or why that is not known."""
        level, beside = percent / 100.0, _LEVELS[percent]
        noisy = f"the step is too small beside the noise at {percent} % of the travel"
        if level < LEFT_SIGMAS * self.noise:
            return noisy
        beyond = self.smooth > level
        if not beyond.any():
            return f"{percent} % of the travel is not passed"
        at = int(beyond.argmax())
        first, last = self._near(at, level, beside)
        for share in _NARROWER if last - first > _MANY else ():
            near = self._near(at, level, share * beside)
            if near[1] - near[0] >= _MANY and share * beside >= _NOISY * self.noise:
                first, last = near
                break
        if last - first < LEAST_FLANK:
            text = f"the sampling is too coarse: {last - first} samples near {percent} %"
            return f"{text}, needed are {LEAST_FLANK}"
        return self._fit(first, last, level) or noisy

    def _near(self, at: int, level: float, beside: float) -> tuple[int, int]:
        """Return first and last sample around one within so much way of a level."""
        low = np.flatnonzero(self.smooth[:at] < level - beside)
        high = np.flatnonzero(self.smooth[at:] > level + beside)
        first = int(low[-1]) + 1 if len(low) else 0
        return first, at + int(high[0]) if len(high) else len(self.way)

    def _fit(self, first: int, last: int, level: float) -> _Crossing | None:
        """Return where a polynomial through samples passes a level; None where it does not."""
        time, way = self.time[first:last], self.way[first:last]
        middle, half = 0.5 * (time[0] + time[-1]), 0.5 * (time[-1] - time[0])
        x = (time - middle) / half
        degree = 1 if len(x) < 6 else 3
        powers = np.vander(x, degree + 1, increasing=True)
        inverse = np.linalg.inv(powers.T @ powers)
        c = inverse @ (powers.T @ way)
        z = 0.0
        for _ in range(20):
            slope, value = 0.0, 0.0
            for k in reversed(c.tolist()):
                slope, value = slope * z + value, value * z + k
            if slope <= 0.0 or abs(z) > 1.5:
                return None
            off = (value - level) / slope
            z -= off
            if abs(off) < _CONVERGED:
                break
        here = z ** np.arange(degree + 1)
        rest = way - powers @ c
        spare = len(x) - degree - 1
        misfit = float(rest @ rest) / spare if spare else 0.0
        spread = max(self.noise**2, misfit if misfit > _MISFIT * self.noise**2 else 0.0)
        error = math.sqrt(spread * float(here @ inverse @ here)) / slope
        if error > _WIDEST * 2.0:
            return None
        return _Crossing(middle + half * z, (half * error) ** 2, slope / half, level)

    def overshoot(self) -> Metric:
        """Return the way beyond the level that is held; its lower limit is 0 below the noise."""
        at = int(self.smooth.argmax())
        height = float(self.smooth[at]) - 1.0
        if height <= _PEAK_SIGMAS * self.noise + 1e-9:
            doubt = math.sqrt(self.noise**2 + self.levels[1])
            return Metric("overshoot", 0.0, 0.0, max(height, 0.0) + NORMAL_975 * doubt)
        rim = 1.0 + _PEAK * height
        low = np.flatnonzero(self.smooth[:at] < rim)
        high = np.flatnonzero(self.smooth[at:] < rim)
        first = int(low[-1]) + 1 if len(low) else 0
        last = at + int(high[0]) if len(high) else len(self.way)
        if last - first < LEAST_FLANK + 1:
            text = f"the sampling is too coarse: {last - first} samples at the overshoot"
            return Metric("overshoot", reason=f"{text}, needed are {LEAST_FLANK + 1}")
        n = last - first
        degree = 2 if n < 8 else 3 if n < 12 else 4
        powers = np.vander(np.linspace(-1.0, 1.0, n), degree + 1, increasing=True)
        inverse = np.linalg.inv(powers.T @ powers)
        tops = _TOPS[:, : degree + 1]
        heights = tops @ (inverse @ (powers.T @ self.way[first:last]))
        here = tops[heights.argmax()]
        value = float(heights.max()) - 1.0
        doubt = math.sqrt(self.noise**2 * float(here @ inverse @ here) + self.levels[1])
        half = NORMAL_975 * doubt
        return Metric("overshoot", max(value, 0.0), max(value - half, 0.0), value + half)
