# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Resistance and inductance from current transients at a held gap, several steps together.

The step responses of paper 001, Fig. 5: voltage steps of 12 and 24 V on a coil whose armature is
held. With the linear kernel i = V/R (1 - exp(-R t/L)); R and L are shared by all steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.solvers.nonlinear import Curve, CurveFit, FitParameter, fit_curves

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import FloatArray


@dataclass(frozen=True, slots=True)
class StepRecord:
    """Currents [A] at times after the step [s], (N,) each, and the voltage of the step [V]."""

    time_s: FloatArray
    current: FloatArray
    voltage: float


def fit_steps(records: Sequence[StepRecord], *, offsets: bool = False) -> CurveFit:
    """Fit resistance [ohm] and inductance [H] to voltage steps at one gap.

    Parameters
    ----------
    records : sequence of StepRecord
        Steps of any voltage but 0, the armature held, the coil not saturated.
    offsets : bool
        Whether each record has a current offset of its own (`offset[k]`).

    Returns
    -------
    CurveFit
        With `resistance` and `inductance`.

    Raises
    ------
    ValueError
        If a voltage is 0 or the currents are all 0.
    """
    for record in records:
        if record.voltage == 0.0 or not np.isfinite(record.voltage):
            message = f"voltage = {record.voltage!r}: must be a number other than 0 [V]"
            raise ValueError(message)
    guesses = [_guess(r) for r in records]
    resistance, inductance = (float(np.median(column)) for column in zip(*guesses, strict=True))
    parameters = [
        FitParameter("resistance", resistance, 0.0, np.inf),
        FitParameter("inductance", inductance, 0.0, np.inf),
    ]
    if offsets:
        parameters.append(FitParameter("offset", 0.0, local=True))

    def function(x: FloatArray, p: FloatArray) -> FloatArray:
        current = _rise(x[:, 0], x[:, 1], p)
        return current + p[2] if offsets else current

    curves = [
        Curve(np.column_stack([r.time_s, np.full(len(r.time_s), r.voltage)]), r.current)
        for r in records
    ]
    return fit_curves(function, curves, parameters)


def step_current(time_s: FloatArray, voltage: float, fit: CurveFit) -> FloatArray:
    """Return the current (N,) of a fit without offsets [A].

    Parameters
    ----------
    time_s : (N,) array
        Times since the step [s].
    voltage : float
        Of the step [V].
    fit : CurveFit
        Of `fit_steps`.
    """
    return _rise(time_s, np.full(len(time_s), voltage), fit.values)


def _rise(time_s: FloatArray, voltage: FloatArray, p: FloatArray) -> FloatArray:
    current: FloatArray = voltage / p[0] * -np.expm1(-p[0] * time_s / p[1])
    return current


def _guess(record: StepRecord) -> tuple[float, float]:
    """Guess resistance and inductance from the largest current and the time to its half."""
    size = np.abs(record.current)
    top = float(size.max())
    if top == 0.0:
        message = "the current stayed at 0"
        raise ValueError(message)
    half = float(record.time_s[int(np.argmax(size >= 0.5 * top))])
    resistance = abs(record.voltage) / top * 0.7
    return resistance, max(resistance * half / np.log(2.0), 1e-9)
