# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Gains and times of the eddy branches from the flux balance of a cycle, near the options.

    sum of V T = R sum of i T + s psi(i - e_1 - e_2, x) + psi_0

for both coils together: the branches are alike, R and psi_0 are each coil's own, s (supply,
sensors and curves beside the options) is known to `_SCALE`. Every number is known beforehand to
the tolerance of its option and stays within it, and within its range. To first order around what
was found, another valve (a constant moved) needs no search of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.data.robust import NORMAL_975
from valve_twin.core.quantity import describe
from valve_twin.core.types import ParameterValue
from valve_twin.core.valves.double_solenoid.coils import flux_record
from valve_twin.core.valves.double_solenoid.eddies import EddyConfig
from valve_twin.core.valves.double_solenoid.parameters import BRANCHES, EDDIES
from valve_twin.core.valves.double_solenoid.record import (
    Record,
    less_eddies,
    longest_part,
    warm_resistances,
)

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.double_solenoid.plant import DoubleSolenoidPlant

_SCALE = 0.02  # standard deviation of s [1], assumed
_METHOD = 0.01  # of what the fit itself leaves of a number [1], assumed
_HIDDEN = 0.1  # of a sample, by which the time of a branch may be off besides [1], assumed
_THINNED = 8  # neighbouring samples of a flux balance err alike: so many count as one, assumed
_FEWEST = 500  # fewest whole samples, assumed
_ROUNDS = 2
_STEP = 1e-3  # for derivatives, of the value [1]
_LEAST = 1e-7  # that a balance leaves [Wb]
_RANGES = np.array(
    [(of.lower, of.upper) for of in describe(EddyConfig) if of.name in BRANCHES]
)  # A/V, s


@dataclass(frozen=True, slots=True)
class EddyFit:
    """What a cycle says of the branches, and how it came to it.

    Attributes
    ----------
    numbers : (4,) array
        `BRANCHES` [A/V], [s].
    errors : (4,) array
        Their standard errors, over the numbers [1].
    widths : (4,) array
        Tolerances of the options [1].
    place : (4,) array
        Logarithms of the numbers over the options [1].
    gain : (4, 2 M) array
        What the balances of both coils, M samples each, change in the logarithms [1/Wb].
    rest : (2 M,) array
        What the balances leave at the numbers [Wb].
    """

    numbers: FloatArray
    errors: FloatArray
    widths: FloatArray
    place: FloatArray
    gain: FloatArray
    rest: FloatArray

    def of(self, record: Record, valve: DoubleSolenoidPlant) -> FloatArray:
        """Return the numbers (4,) that another valve of the options would have been given.

        Parameters
        ----------
        record : Record
            The same cycle, as that valve would have it.
        valve : DoubleSolenoidPlant
            With another constant, and the branches of the options.
        """
        rest = _balance(record, valve, warm_resistances(record, valve), self.place)[0].ravel()
        moved = self.place + self.gain @ (rest - self.rest)
        return _around(valve, np.clip(moved, -self.widths, self.widths))

    def values(self) -> tuple[ParameterValue, ...]:
        """Return the numbers as they are published."""
        half = NORMAL_975 * self.errors * self.numbers
        found = zip(BRANCHES, self.numbers.tolist(), half.tolist(), strict=True)
        return tuple(
            ParameterValue(f"{EDDIES}{n}", v, lower_95=v - h, upper_95=v + h) for n, v, h in found
        )


def named(numbers: FloatArray) -> dict[str, float]:
    """Return numbers of the branches (4,) by the names that `known_valve` takes."""
    return {f"{EDDIES}{n}": v for n, v in zip(BRANCHES, numbers.tolist(), strict=True)}


def fit_eddies(
    record: Record, valve: DoubleSolenoidPlant, resistances: list[float], widths: FloatArray
) -> EddyFit | None:
    """Fit the branches to a cycle; None where too few samples are whole or nothing comes of it.

    Parameters
    ----------
    record : Record
        What was measured.
    valve : DoubleSolenoidPlant
        Its curves and branches count.
    resistances : list of float
        Of the coils [ohm].
    widths : (4,) array
        Tolerances of the branches [1].
    """
    part = longest_part(record.known)
    if part.stop - part.start < _FEWEST or not widths.any():
        return None
    free = widths > 0.0
    precision = np.append(np.where(free, 3.0 / np.maximum(widths, 1e-12) ** 2, 1e18), _SCALE**-2)
    place = np.zeros(4)
    for _ in range(_ROUNDS):
        rest, flux = _balance(record, valve, resistances, place)
        rows = [flux.ravel()]
        ways = np.where(_around(valve, place + _STEP) < _RANGES[:, 1], _STEP, -_STEP)
        for j, way in enumerate(ways):
            step = np.where(np.arange(4) == j, way, 0.0)
            moved = _balance(record, valve, resistances, place + step)[0] - rest
            rows.insert(j, -moved.ravel() / way if free[j] else np.zeros(moved.size))
        matrix = np.column_stack(rows)
        wanted = rest.ravel() + matrix[:, :4] @ place
        if not (np.isfinite(matrix).all() and np.isfinite(wanted).all()):
            return None
        alone = np.linalg.lstsq(matrix, wanted, rcond=1e-12)[0]
        noise = max(float(np.sqrt(np.mean((wanted - matrix @ alone) ** 2))), _LEAST)
        normal = matrix.T @ matrix / noise**2 + np.diag(precision)
        covariance = np.linalg.inv(normal)
        gain = covariance @ matrix.T / noise**2
        found = gain @ wanted
        place = np.clip(found[:4], -widths, widths)
    numbers = _around(valve, place)
    method = np.full(4, _METHOD**2)
    method[1::2] += (_HIDDEN * record.period_s / numbers[1::2]) ** 2
    errors = np.minimum(np.sqrt(np.diag(covariance)[:4] + method), widths / np.sqrt(3.0))
    rest = _balance(record, valve, resistances, place)[0].ravel()
    return EddyFit(numbers, errors, widths, place, gain[:4], rest)


def _around(valve: DoubleSolenoidPlant, logarithms: FloatArray) -> FloatArray:
    of = valve.eddies
    numbers = np.array([of.gain_1, of.time_1, of.gain_2, of.time_2]) * np.exp(logarithms)
    return np.asarray(np.clip(numbers, *_RANGES.T))


def _balance(
    record: Record, valve: DoubleSolenoidPlant, resistances: list[float], at: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return what the balances of both coils leave, and their flux linkages, (2, M) each [Wb]."""
    found = zip(BRANCHES, _around(valve, at).tolist(), strict=True)
    of, part = replace(valve.eddies, **dict(found)), longest_part(record.known)
    shown = less_eddies(record, of.numbers(), resistances)
    places = np.arange(part.start + _THINNED, part.stop - 1, _THINNED)
    pairs = np.repeat(places, 2)  # `flux_record` takes means of neighbours
    currents = [0.5 * (i[pairs] + i[pairs + 1]) for i in (shown.current_a, shown.current_b)]
    x = np.ascontiguousarray(record.x[pairs])
    rest, flux = np.empty((2, len(places))), np.empty((2, len(places)))
    for k in range(2):
        psi = np.empty(len(pairs))
        flux_record(valve.tables(), k, currents[k], currents[1 - k], x, psi)
        charge, applied = (
            np.cumsum(v[:, k])[places] * record.period_s for v in (record.drawn, record.volts)
        )
        beside = np.linalg.qr(np.column_stack([charge, np.ones(len(places))]))[0]
        for out, values in ((flux, psi[::2]), (rest, applied - psi[::2])):
            out[k] = values - beside @ (beside.T @ values)
    return rest, flux
