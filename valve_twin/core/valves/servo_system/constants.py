# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The known constants of the servosystem as unknowns that are known within their tolerances.

Areas, lengths, inertia, gains of the sensors do not change from cycle to cycle: the first cycle
that shows them tells them with its parameters, by Gauss and Newton with all sensitivities, and the
cycles after it keep what it found. What it left in doubt is in every estimate alike.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.data.robust import NORMAL_975
from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.types import EstimateStatus, ParameterStatus, ParameterValue
from valve_twin.core.valves.kit.tolerances import Tolerated, contradicted, limits
from valve_twin.core.valves.servo_system.fit import (
    START,
    STEPS,
    UNKNOWNS,
    WARMED,
    WARMING,
    LoopProblem,
    rank,
)
from valve_twin.core.valves.servo_system.numbers import PHYSICAL, derive
from valve_twin.core.valves.servo_system.parameters import ESTIMATOR, NAMES, SCALES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import BoolArray, Estimate, FloatArray
    from valve_twin.core.valves.servo_system.fit import LoopFit
    from valve_twin.core.valves.servo_system.plant_kernel import Sensors
    from valve_twin.core.valves.servo_system.record import Record

VISCOSITY = "viscosity"
"""The one that is no constant: it follows the temperature of the oil, cycle by cycle."""

HOPELESS = 50.0
"""Residual over the noise from which no constant inside its tolerance is looked for [1]."""

_REPEATED = 25  # cycles after which the constants are published again: a memory holds fifty
_KEPT = "a constant, kept as the record that told it"
_WARM = "of this cycle: it follows the temperature of the oil"
_ROUNDS = 14
_TURNS = 3  # rounds along principal axes at least
_CLOSE = 1.7  # residual over the noise, squared, from which axes are turned [1]
_LENGTH = 2.0  # of a step along a principal axis [standard deviations]
_SETTLED = 4.0  # gain below which a step was the last [1]
_DAMPINGS = (0.0, 1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0)
_TINY = 1e-300
_LEAST = 1e-12  # eigenvalue over the largest that counts [1]
_WIDER = 2.0  # parameters that are told by half join the search [1]
_STEP = 0.5  # along a constant, over its tolerance [1]
_REACH = 20.0  # how far a constant is searched, in tolerances [1]


@dataclass(frozen=True, slots=True)
class Known:
    """What cycles have told of the constants.

    Attributes
    ----------
    constants : Tolerated
        The K constants.
    found, errors : (K,) arrays
        The constants over their options, and their standard errors [1].
    alike : (12,) array
        What they leave in doubt of the parameters, standard errors over the values [1]; NaN where
        no cycle has told the parameter.
    limits : tuple of str
        Which tolerances limit each of the parameters, in one line; empty where the noise does.
    due : bool
        Whether this cycle is to publish them.
    options : (K,) array
        Values of the options [unit of each].
    parameters : (12,) array
        The parameters that go with them, NaN where unknown [their units].
    contradiction : str
        Which constant lies beyond its tolerance, empty if none.
    """

    constants: Tolerated
    found: FloatArray
    errors: FloatArray
    alike: FloatArray
    limits: tuple[str, ...]
    due: bool
    options: FloatArray
    parameters: FloatArray
    contradiction: str = ""

    def missing(self, told: BoolArray) -> bool:
        """Tell whether a parameter is told whose doubt is not known.

        Parameters
        ----------
        told : (12,) bool array
            Parameters that a cycle tells.
        """
        return bool(np.any(told & ~np.isfinite(self.alike)))

    def beyond(self, noise: FloatArray) -> Known:
        """Return this with the noise of the parameters, which is new in every cycle, taken out.

        Parameters
        ----------
        noise : (12,) array
            Their standard errors with the constants known, over the values [1].
        """
        return replace(self, alike=np.sqrt(np.maximum(self.alike**2 - noise**2, 0.0)))

    def published(self, warmed: tuple[float, float]) -> list[ParameterValue]:
        """Return the constants as values of an estimate, where they are due; viscosity always.

        Parameters
        ----------
        warmed : tuple
            What the cycle's viscosity is over the one known, less 1, and its standard error [1].
        """
        shown = [n for n in self.constants.names if self.due or n == VISCOSITY]
        return [self._published(name, warmed) for name in shown]

    def _published(self, name: str, warmed: tuple[float, float]) -> ParameterValue:
        k = self.constants.names.index(name)
        value, error = float(self.options[k] * self.found[k]), float(self.errors[k])
        error *= abs(float(self.options[k]))
        reason = _KEPT
        if name == VISCOSITY:
            change, doubt = warmed
            value, reason = value * (1.0 + change), _WARM
            error = float(np.hypot(error, abs(value) * doubt)) if self.due else abs(value) * doubt
        half = NORMAL_975 * error
        return ParameterValue(
            name, value, ParameterStatus.OK, reason, error, value - half, value + half
        )


def recall(earlier: Sequence[Estimate], constants: Tolerated, options: object) -> Known:
    """Return what earlier estimates of the memory say of the constants.

    Parameters
    ----------
    earlier : sequence of Estimate
        Estimates so far, oldest first.
    constants : Tolerated
        The K constants.
    options : dataclass
        Their values as configured.
    """
    values = np.array([getattr(options, name) for name in constants.names])
    last: dict[str, ParameterValue] = {}
    age = 0
    for estimate in earlier:
        if estimate.estimator == ESTIMATOR and estimate.status is not EstimateStatus.REFUSED:
            given = {p.name: p for p in estimate.parameters if p.usable}
            last |= given
            age = 0 if given.keys() >= set(constants.names) else age + 1
    known = [last.get(name) for name in constants.names]
    if not known or not all(known):
        nothing = np.full(len(NAMES), np.nan if constants.names else 0.0)
        ones = np.ones(len(values))
        return Known(
            constants, ones, constants.sigmas, nothing, ("",) * len(NAMES), False, values, nothing
        )
    told = [last.get(name) for name in NAMES]
    return Known(
        constants=constants,
        found=np.array([p.value for p in known if p]) / values,
        errors=np.array([_kept_error(p) for p in known if p]) / np.abs(values),
        alike=np.array([_alike(p) if p else np.nan for p in told]),
        limits=tuple(p.reason if p else "" for p in told),
        due=age >= _REPEATED,
        options=values,
        parameters=np.array([p.value if p else np.nan for p in told]),
    )


def _kept_error(p: ParameterValue) -> float:
    """Return the standard error of a constant [its unit]; every cycle has its own viscosity."""
    return 0.0 if p.name == VISCOSITY else p.standard_error


def _alike(p: ParameterValue) -> float:
    """Return what of an interval is in every cycle alike, standard error over the value [1]."""
    half = max(p.upper_95 - p.value, p.value - p.lower_95) / NORMAL_975
    return float(np.sqrt(max(half**2 - p.standard_error**2, 0.0)) / abs(p.value))


def with_constants(
    p: FloatArray, sensors: Sensors, constants: Tolerated, found: FloatArray
) -> tuple[FloatArray, Sensors]:
    """Return the numbers of the compiled functions with other constants.

    Parameters
    ----------
    p : (COUNT,) array
        Numbers of the options, see `numbers`.
    sensors : Sensors
        Full scales of the options.
    constants : Tolerated
        The K constants.
    found : (K,) array
        Their values over those of the options [1].
    """
    p, scales = p.copy(), {}
    for name, share in zip(constants.names, found.tolist(), strict=True):
        if name in SCALES:
            scales[SCALES[name]] = getattr(sensors, SCALES[name]) * share
        else:
            p[PHYSICAL.index(name)] *= share
    derive(p)
    return p, sensors._replace(**scales)


def open_constants(
    record: Record,
    numbers: tuple[FloatArray, Sensors],
    known: Known,
    fit: LoopFit,
    max_error: float,
) -> Known | None:
    """Find parameters and constants together; None where the simulation fails.

    Many directions hardly change the signals: all forces, masses and pressures larger, say. What
    they change is lost in the differences along each unknown alone. So close to the minimum the
    sensitivities are taken along the principal axes of what is known so far, a step as long as it
    is known well.

    Parameters
    ----------
    record : Record
        N samples of nine signals.
    numbers : tuple
        Numbers (COUNT,) and full scales of the options.
    known : Known
        The constants as in the options.
    fit : LoopFit
        The fit with the constants as in the options.
    max_error : float
        Relative standard error above which a parameter is held [1].
    """
    whole = _Whole(record, numbers, known.constants)
    z = np.concatenate((fit.unknowns, np.ones(len(known.constants.names))))
    if VISCOSITY in known.constants.names:  # of the first cycle it is the constant
        z[UNKNOWNS + known.constants.names.index(VISCOSITY)] += z[WARMED]
        z[WARMED] = 0.0
    r = whole.residual(z)
    axes, free, turned = np.empty(0), np.ones(len(z), dtype=np.bool_), 0
    for _ in range(_ROUNDS):
        if not turned:
            axes = whole.each(z)
        along = None if r is None else whole.along(z, r, axes)
        if r is None or along is None:
            return None
        if not turned:
            free = _free(along, z, r, max_error)
            axes, along = axes[:, free], along[:, free]
        size = np.maximum(np.linalg.norm(along, axis=0), _TINY)
        axes, along = axes / size, along / size
        values, vectors = np.linalg.eigh(along.T @ along)
        values = np.maximum(values, _LEAST * values[-1])
        before = float(r @ r)
        z, r = whole.descend(z, r, axes @ vectors, (along @ vectors, values), turned > 0)
        axes = axes @ (vectors / np.sqrt(values))
        covariance = axes @ axes.T
        gained = before - float(r @ r)
        close = before < _CLOSE * len(r)
        axes, turned = _LENGTH * axes, turned + 1 if close else 0
        if turned >= _TURNS and gained < _SETTLED:
            break
    if r is None:
        return None
    return _told(known, whole.base, z, r, covariance)


def _free(along: FloatArray, z: FloatArray, r: FloatArray, max_error: float) -> BoolArray:
    """Return the unknowns that act: parameters that the record tells, constants with an effect."""
    misfit = max(float(np.sqrt(np.mean(r * r))), 1.0)
    steps = _steps(z, np.empty(0))
    told = rank(along[:, :UNKNOWNS] / steps, z[:UNKNOWNS], _WIDER * max_error / misfit)
    told[WARMED] = False
    return np.concatenate((told, np.ones(len(z) - UNKNOWNS, dtype=np.bool_)))


def _steps(z: FloatArray, widths: FloatArray) -> FloatArray:
    """Return the steps of the differences along each unknown (UNKNOWNS + K,)."""
    parameters = STEPS * np.where(np.arange(UNKNOWNS) < START, z[:UNKNOWNS], 1.0)
    return np.concatenate((parameters, _STEP * widths))


def _told(
    known: Known, base: FloatArray, z: FloatArray, r: FloatArray, covariance: FloatArray
) -> Known:
    misfit = max(float(np.sqrt(np.mean(r * r))), 1.0)
    errors = misfit * np.sqrt(np.diag(covariance))
    unsure = known.constants
    free = errors[:START] > 0.0
    kept = np.append(np.flatnonzero(free), np.arange(UNKNOWNS, len(z)))
    lines = iter(limits(covariance[np.ix_(kept, kept)], unsure))
    found = z[UNKNOWNS:]
    return replace(
        known,
        found=found,
        errors=np.minimum(errors[UNKNOWNS:], unsure.sigmas),
        alike=np.where(free, errors[:START] / z[:START], np.nan),
        limits=tuple(next(lines) if one else "" for one in free),
        due=True,
        parameters=base * z[:START],
        contradiction=_contradiction(found, errors[UNKNOWNS:], unsure),
    )


def _contradiction(found: FloatArray, errors: FloatArray, constants: Tolerated) -> str:
    """Return which constant lies beyond its tolerance, none by what the oil's temperature does."""
    warm = (np.array(constants.names) == VISCOSITY) & (abs(found - 1.0) < NORMAL_975 * WARMING)
    firm = np.flatnonzero(~warm)
    names = tuple(constants.names[k] for k in firm)
    return _refusal(
        contradicted(found[firm], errors[firm], Tolerated(names, constants.widths[firm]))
    )


class _Whole:
    """The residual over the noise, with what tolerances say, of parameters and constants."""

    def __init__(
        self, record: Record, numbers: tuple[FloatArray, Sensors], constants: Tolerated
    ) -> None:
        self._record, self._numbers, self._constants = record, numbers, constants
        inside = LoopProblem(record, *numbers)
        reach = _REACH * constants.widths
        self.base = inside.base
        self._lower = np.concatenate((inside.lower, np.maximum(1.0 - reach, 0.05)))
        self._upper = np.concatenate((inside.upper, 1.0 + reach))

    def residual(self, z: FloatArray) -> FloatArray | None:
        """Return the residual (M + K,); None where the integration fails."""
        numbers = with_constants(*self._numbers, self._constants, z[UNKNOWNS:])
        r = LoopProblem(self._record, *numbers).residual(z[:UNKNOWNS])
        known = (z[UNKNOWNS:] - 1.0) / self._constants.sigmas
        return None if r is None else np.concatenate((r, known))

    def each(self, z: FloatArray) -> FloatArray:
        """Return the unknowns themselves as axes (U, U)."""
        return np.diag(_steps(z, self._constants.widths))

    def along(self, z: FloatArray, r: FloatArray, axes: FloatArray) -> FloatArray | None:
        """Return what a step along each of the axes (U, A) changes in the residual (M + K, A)."""
        changes = np.empty((len(r), axes.shape[1]))
        for k, axis in enumerate(axes.T):
            inside = np.all((z + axis >= self._lower) & (z + axis <= self._upper))
            there = self.residual(z + (axis if inside else -axis))
            if there is None:
                return None
            changes[:, k] = there - r if inside else r - there
        return changes

    def descend(
        self,
        z: FloatArray,
        r: FloatArray,
        axes: FloatArray,
        along: tuple[FloatArray, FloatArray],
        close: bool,
    ) -> tuple[FloatArray, FloatArray]:
        """Return where a step of Gauss and Newton, shortened until it gains, leads."""
        changes, values = along
        gradient = changes.T @ r
        for damping in _DAMPINGS[int(not close) :]:
            step = axes @ (gradient / (values + damping))
            trial = np.clip(z - step, self._lower, self._upper)
            there = self.residual(trial)
            if there is not None and float(there @ there) < float(r @ r):
                return trial, there
        return z, r


def _refusal(text: str) -> str:
    return Refusal(RefusalCode.OPTIONS, text) if text else ""
