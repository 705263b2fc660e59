# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What one cycle shows of faults: a few plain numbers, each from the samples that show it best.

Not estimates of a model: every number is a mean, a slope or a share over one kind of samples, so
that a fault which breaks the model (a frozen sensor, a lost command) still leaves its mark. They
are stored beside the estimates as those of the estimator `features`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.direct.bounds import OFF_SEAT, WEAK_SMALL
from valve_twin.core.diagnosis.direct.freezing import DUE, MISSED
from valve_twin.core.diagnosis.features import PERIOD, RETURNS, FeatureSet
from valve_twin.core.estimation.data.masks import held_recently
from valve_twin.core.estimation.data.noise import find_rest, rest_noise
from valve_twin.core.estimation.data.robust import find_spikes
from valve_twin.core.types import Parameter, ParameterStatus, ParameterValue
from valve_twin.core.valves.press_cartridge.diagnosis.missed import missed_values

if TYPE_CHECKING:
    from valve_twin.core.estimation.data.masks import Masks
    from valve_twin.core.types import BoolArray, FloatArray, Frames

_PER_COMMAND = "stroke a sample per unit command"

COUNTS = (
    Parameter(MISSED, "1", "values that the sensor repeated while the position moved on", 0.0),
    Parameter(DUE, "1", "values in motions so fast that each must differ from the last", 0.0),
    Parameter(OFF_SEAT, "1", "distance from the lower seat at rest, 0 = where it may be"),
    Parameter(WEAK_SMALL, "1", "share of a large command's gain that a small one lacks, 0 = few"),
    Parameter(RETURNS, "s", "time from the start of a cycle to its first large outflow command"),
    Parameter(PERIOD, "s", "time between the samples of a cycle", 0.0),
)
"""What stands beside the features: it needs no past of the valve to be compared with."""

FEATURES = (
    Parameter("rest_level", "1", "feature: mean position at rest on the lower seat"),
    Parameter("rest_noise", "1", "feature: position noise at rest", 0.0),
    Parameter("hold_slope", "1/s", "feature: slope of the position in hold off the seats"),
    Parameter("gain_in_low", "1", f"feature: {_PER_COMMAND}, runs of small inflow"),
    Parameter("gain_in_high", "1", f"feature: {_PER_COMMAND}, runs of large inflow"),
    Parameter("gain_out_low", "1", f"feature: {_PER_COMMAND}, runs of small outflow"),
    Parameter("gain_out_high", "1", f"feature: {_PER_COMMAND}, runs of large outflow"),
    Parameter("delay_in", "s", "feature: time from large inflow command to motion"),
    Parameter("delay_out", "s", "feature: time from large outflow command to motion"),
    Parameter("rough_low", "1", "feature: rms about the line in runs of small inflow", 0.0),
    Parameter("shortfall", "1", "feature: most motion that a sample of large command lacks", 0.0),
    Parameter("repeats", "1", "feature: share of samples that repeat the one before", 0.0, 1.0),
    Parameter("stuck", "1", "feature: share of samples commanded without motion", 0.0, 1.0),
)
"""What the features are, in the order of `cycle_features`; the counts stand behind them."""

NAMES = tuple(p.name for p in FEATURES)
_STORED = (*NAMES, *(p.name for p in COUNTS))

_BELOW_SEAT = 0.25
"""Share of the seat margin by which a closed spool may press into its seat, assumed [1]."""

_LEAST_SMALL = 0.6
"""Gain of small commands over that of large ones, below which small ones lack effect [1]: of 119
strangers without a fault the least has 0.74."""

_LEAST_SPIKE = 6e-3
"""Height of a single outlier that is left out [1]: what noise of 5e-4 does not reach."""

_FAR, _LEAST_STRAY, _FEW = 8.0, 3e-3, 0.05
"""Distance of a single outlier from the level at rest [standard deviations of the noise, 1], and
the share of the rest below which they are single [1]: a spool that creeps is not."""

_LEAST_KNOWN = 0.1
"""Standard error of a gain over that of large commands, from which on noise hides it [1]."""

_SURE = 3.0
"""Standard errors by which a small command must lack effect to be said to [1]."""

_DITHER = 1.5
"""Spread of nine tenths of the values at rest in steps of the sensor, below which they are one
value or two beside each other: their mean tells no more than they do [1]."""

_COARSE = 3e-4
"""Step of a sensor above which that matters [1]: that of 12 bits is 2.9e-4 of the stroke."""

_OF_STEP = 1.0
"""Most noise that a sensor shows which is between two of its steps [steps]."""

NO_GAIN = 1e-6
"""Gain of a command that moves nothing, or the wrong way: its logarithm must exist."""

_GAINS = ("gain_in_low", "gain_in_high", "gain_out_low", "gain_out_high")

RELATIVE = frozenset(("rest_noise", *_GAINS, "rough_low", "shortfall"))
"""Features whose changes count relative to themselves: their logarithm is followed."""

FEATURE_SET = FeatureSet(
    NAMES,
    RELATIVE,
    shares=("repeats", "stuck"),
    gains=_GAINS,
    slopes=("hold_slope",),
    first_sizes={
        "leak": 1e-4,
        "stiction": 0.01,
        "preload": 1e-3,
        "coil_resistance": 0.02,
        "dead_band": 2e-3,
        "aeration": 0.03,
        "sensor_offset": 3e-4,
        "sensor_gain": 0.02,
        "sensor_freeze": 5e-3,
        "command_loss": 0.02,
        "supply_drop": 0.03,
    },
    largest={"aeration": 0.9, "supply_drop": 0.9, "sensor_freeze": 0.9, "command_loss": 0.9},
    across={
        "rest_level": 5e-4,
        "rest_noise": 0.1,
        "hold_slope": 3e-4,
        "gain_in_low": 0.2,
        "gain_in_high": 0.2,
        "gain_out_low": 0.08,
        "gain_out_high": 0.02,
        "delay_out": 0.01,
        "rough_low": 0.25,
        "shortfall": 0.16,
        "repeats": 0.02,
    },  # four of five changes of 24 strangers are smaller
)
"""How they are followed, and the faults that they show."""


@dataclass(frozen=True, slots=True)
class FeatureOptions:
    """Where a cycle is looked at.

    Attributes
    ----------
    lower_seat, upper_seat : float
        Positions of the seats [1].
    margin : float
        Distance from a seat that a spool which rests on it may have [1].
    near : float
        Distance from a seat within which the spool counts as resting on it [1].
    active_command : float
        Command above which an input acts [1].
    low_command : float
        Commands from `active_command` up to this are small [1].
    high_command : float
        Commands above this are large [1].
    lag : int
        Command to position lag [samples]; the same in all cycles, so that a later motion shows.
    settle : int
        Samples after the last command that do not count as rest.
    min_run : int
        Fewest samples of a run that gives a gain.
    max_gaps : float
        Gaps a sample above which nothing is said: what is lost on the way is no fault of the
        valve.
    """

    lower_seat: float = 0.0
    upper_seat: float = 1.0
    margin: float = 0.01
    near: float = 0.05
    active_command: float = 0.01
    low_command: float = 0.2
    high_command: float = 0.25
    lag: int = 2
    settle: int = 15
    min_run: int = 5
    max_gaps: float = 0.01


@dataclass(frozen=True, slots=True)
class _Line:
    """A straight line through position over summed command, in runs of samples.

    `spread` is the sum of squares of the summed command about its mean.
    """

    gain: float = np.nan
    spread: float = 0.0
    delay: float = np.nan
    rough: float = np.nan
    shortfall: float = np.nan


_NO_LINE = _Line()


def cycle_features(
    frames: Frames, masks: Masks, period_s: float, options: FeatureOptions
) -> tuple[ParameterValue, ...]:
    """Return the features of one cycle in the order of `FEATURES`, then the `COUNTS`.

    Parameters
    ----------
    frames : Frames
        Samples of one cycle, inputs (inflow, outflow).
    masks : Masks
        Its masks.
    period_s : float
        Sampling time [s].
    options : FeatureOptions
        Where to look.

    Returns
    -------
    tuple of ParameterValue
        NOT_EXCITED and NaN where the cycle does not show a feature.
    """
    if np.count_nonzero(masks.gap) > options.max_gaps * len(frames):
        return tuple(_value(name, np.nan, "samples are missing") for name in _STORED)
    masks = replace(masks, bad=masks.bad | find_spikes(frames.position, _LEAST_SPIKE))
    x, good = frames.position, ~masks.bad & np.isfinite(frames.position)
    good &= ~held_recently(masks.gap, options.lag)  # sums of commands do not reach over a gap
    rest = find_rest(frames, masks, active_command=options.active_command, settle=options.settle)
    low = rest & good & (x < options.lower_seat + options.near)
    free = rest & good & (x > options.lower_seat + options.near)
    hold = _runs(free & (x < options.upper_seat - options.near), 4 * options.min_run)
    noise = rest_noise(
        frames,
        masks,
        active_command=options.active_command,
        settle=options.settle,
        outliers=False,
    )
    into = _lines(frames, good, 0, 1.0, options)
    out = _lines(frames, good, 1, -1.0, options)
    repeats = np.count_nonzero(np.diff(x) == 0.0) / max(len(x) - 1, 1)
    missed = missed_values(x)
    sigma = float(np.fmax(noise.sigma, missed.quantum / np.sqrt(12.0)))
    low &= ~_strays(x, low, sigma)
    level = float(x[low].mean()) if np.count_nonzero(low) >= options.min_run else np.nan
    in_low, out_low = _shown(*into, sigma), _shown(*out, sigma)
    off = _resolved(x[low], missed.quantum, options) if np.isfinite(level) else np.nan
    values = (
        options.lower_seat + off,
        _of_steps(noise.sigma, missed.quantum),
        _slope(x, hold, period_s),
        in_low.gain,
        into[1].gain,
        out_low.gain,
        out[1].gain,
        into[1].delay * period_s,
        out[1].delay * period_s,
        in_low.rough,
        np.fmax(into[1].shortfall, out[1].shortfall),
        repeats,
        np.count_nonzero(masks.stuck) / max(len(x), 1),
        missed.missed,
        missed.due,
        _off_seat(level - options.lower_seat, noise.sigma, missed.quantum, options.margin),
        _weak_small(sigma, into, out),
        _returns(frames, period_s, options),
        period_s,
    )
    return tuple(_value(name, v) for name, v in zip(_STORED, values, strict=True))


def _value(
    name: str, value: float, reason: str = "the cycle does not show this"
) -> ParameterValue:
    if np.isfinite(value) and not (name in RELATIVE and value <= 0.0):
        return ParameterValue(name, float(value))
    return ParameterValue(name, np.nan, ParameterStatus.NOT_EXCITED, reason)


def _strays(x: FloatArray, low: BoolArray, sigma: float) -> BoolArray:
    """Return which samples at rest are single outliers, which no search for spikes finds."""
    if not low.any():
        return low
    far = np.abs(x - np.median(x[low])) > np.fmax(_FAR * sigma, _LEAST_STRAY)
    few = np.count_nonzero(far & low) < _FEW * np.count_nonzero(low)
    return np.asarray(far & low & few, dtype=np.bool_)


def _returns(frames: Frames, period_s: float, options: FeatureOptions) -> float:
    """Return when the first large outflow command comes [s]; NaN without any."""
    large = np.flatnonzero(frames.inputs[:, 1] > options.high_command)
    return float(large[0]) * period_s if len(large) else float("nan")


def _resolved(rest: FloatArray, quantum: float, options: FeatureOptions) -> float:
    """Return the mean distance from the seat as far as the steps of the sensor tell it [1].

    Where no noise carries it over its steps, one value tells it to a step; a mean of two that are
    beside each other tells nothing more, and moves by a step where the position hardly did: NaN.
    """
    low, high = np.quantile(rest, (0.05, 0.95))
    if quantum <= _COARSE or high - low >= _DITHER * quantum:
        return float(rest.mean()) - options.lower_seat
    return float(low) - options.lower_seat if high == low else float("nan")


def _of_steps(sigma: float, quantum: float) -> float:
    """Return the noise at rest, none less than what a sensor between two of its steps shows."""
    return max(sigma, _OF_STEP * quantum) if sigma > 0.0 and quantum > _COARSE else sigma


def _shown(small: _Line, large: _Line, sigma: float) -> _Line:
    """Return the line of small commands, without its gain where noise hides it.

    Measured in the gain of large ones, where there is one: a small one may be without effect.
    """
    usual = large.gain if large.gain > NO_GAIN else small.gain
    return replace(small, gain=np.nan) if _error(small, sigma) > _LEAST_KNOWN * usual else small


def _error(line: _Line, sigma: float) -> float:
    """Return the standard error of a gain from noise alone, 0 where that is not known."""
    return sigma / line.spread**0.5 if line.spread > 0.0 else 0.0


def _off_seat(level: float, sigma: float, quantum: float, margin: float) -> float:
    """Return the level at rest where no closed spool shows it, else 0 [1]."""
    doubt = 0.5 * quantum + np.nan_to_num(sigma)
    if not np.isfinite(level) or -_BELOW_SEAT * margin - doubt <= level <= margin + doubt:
        return level if np.isnan(level) else 0.0
    return level


def _weak_small(sigma: float, *directions: tuple[_Line, _Line]) -> float:
    """Return how much of its gain a small command lacks where that is much, else 0 [1].

    What noise of `sigma` may hide counts as there.
    """
    known = [
        (small.gain / large.gain, _SURE * _error(small, sigma) / large.gain)
        for small, large in directions
        if large.gain > NO_GAIN and np.isfinite(small.gain)
    ]
    if not known:
        return float("nan")
    lacking = [1.0 - ratio for ratio, doubt in known if ratio + doubt < _LEAST_SMALL]
    return max(lacking, default=0.0)


def _runs(flag: BoolArray, fewest: int = 1) -> list[slice]:
    """Return the runs of True of at least `fewest` samples."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flag.astype(np.int8), [0]))))
    pairs = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    return [slice(a, b) for a, b in pairs if b - a >= fewest]


def _slope(x: FloatArray, runs: list[slice], period_s: float) -> float:
    """Return the common slope of the position in all runs [1/s]; NaN without any."""
    above = below = 0.0
    for part in runs:
        y = x[part]
        t = np.arange(len(y)) - 0.5 * (len(y) - 1)
        above += float(t @ y)
        below += float(t @ t)
    return above / below / period_s if below > 0.0 else float("nan")


def _lines(
    frames: Frames, good: BoolArray, index: int, sign: float, options: FeatureOptions
) -> tuple[_Line, _Line]:
    """Return the lines of small and of large commands of one input."""
    v = np.nan_to_num(frames.inputs[:, index])
    x = sign * frames.position
    low = good & (v > options.active_command) & (v < options.low_command)
    small = _runs(low, options.min_run)
    large = _runs(good & (v > options.high_command), options.min_run)
    return _line(x, v, good, small, options), _line(x, v, good, large, options)


def _line(
    x: FloatArray, v: FloatArray, good: BoolArray, runs: list[slice], options: FeatureOptions
) -> _Line:
    """Fit x = level + gain (sum of commands - delay * command), a level in each run."""
    centred, delayed = [], []
    for part in runs:
        first, last = part.start + options.lag, min(part.stop + options.lag, len(x))
        known = good[first:last]
        if np.count_nonzero(known) < options.min_run:
            continue
        c = np.cumsum(v[part.start : part.start + last - first])[known]
        y = x[first:last][known]
        centred.append((c - c.mean(), y - y.mean()))
        before = slice(max(part.start - 10, 0), part.start + 1)
        still = v[before][:-1] <= options.active_command
        start = x[before]
        if len(still) and still.all() and good[before].all():
            delayed.append((c.mean(), y.mean() - start.mean(), float(v[part].mean())))
    if not centred:
        return _NO_LINE
    dc = np.concatenate([c for c, _ in centred])
    dy = np.concatenate([y for _, y in centred])
    spread = float(dc @ dc)
    gain = max(float(dc @ dy) / spread, NO_GAIN) if spread > 0.0 else float("nan")
    rough = float(np.sqrt(np.mean((dy - gain * dc) ** 2)))
    shortfall = max(_shortfall(c, y) for c, y in centred)
    if not delayed or not gain > NO_GAIN:
        return _Line(gain, spread, rough=rough, shortfall=shortfall)
    delay = np.mean([(c - moved / gain) / command for c, moved, command in delayed])
    return _Line(gain, spread, float(delay), rough, shortfall)


def _shortfall(c: FloatArray, y: FloatArray) -> float:
    """Return the most motion that a sample lacks against the others of its run [1].

    The first sample of a run is left out: the spool is just setting off.
    """
    command, moved = np.diff(c)[1:], np.diff(y)[1:]
    if len(moved) < 4:
        return float("nan")
    columns = np.stack((command, command**2), axis=1)
    expected = columns @ np.linalg.lstsq(columns, moved, rcond=None)[0]
    return float(np.max(expected - moved))
