# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Stiffness and damping of the second order, or only their ratio where a record shows no more.

With stiffness = rate / lag and damping = 1 / lag both run to infinity together as the lag goes to
zero, and their ratio, the rate, stays: a ridge. The record separates them if its sensitivities
do, and if the lag is longer than the time that passes between two values of the command: what
happens in between was not recorded.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.solvers.identifiability import assess_identifiability
from valve_twin.core.types import ParameterStatus, ParameterValue
from valve_twin.core.valves.positioner.extended import LAG
from valve_twin.core.valves.positioner.fit_extended import correlated_sigma
from valve_twin.core.valves.positioner.parameters import SECOND_ORDER

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.positioner.fit import Record
    from valve_twin.core.valves.positioner.fit_extended import Extended

_LEAST_CHANGES = 20  # changes of the command that show how often it is refreshed [1], assumed


def column(fit: Extended, i: int) -> FloatArray:
    """Return the derivative (N,) of the residual by parameter i, 0 where it was not fitted."""
    where = np.flatnonzero(fit.free == i)
    return fit.jacobian[:, where[0]] if len(where) else np.zeros(len(fit.residual))


def refresh_s(record: Record) -> float:
    """Return the usual time between two values of the command [s], at least a sampling time.

    A command that steps now and then is held, not refreshed slowly: it takes many changes to see.
    """
    changes = np.flatnonzero(np.diff(record.command) != 0.0)
    if len(changes) < _LEAST_CHANGES:
        return record.period_s
    return float(np.median(np.diff(changes))) * record.period_s


def second_order(lag: ParameterValue, fit: Extended, record: Record) -> list[ParameterValue]:
    """Return lag, stiffness both ways and damping; refused on a ridge, with what is known.

    Parameters
    ----------
    lag : ParameterValue
        The fitted lag [s].
    fit : Extended
        The fit.
    record : Record
        What was fitted.
    """
    lag_s = float(fit.parameters[LAG])
    damping = 1.0 / lag_s
    values = np.array([*(fit.parameters[:2] * damping), damping])
    identifiability = assess_identifiability(
        SECOND_ORDER[1:], values, _sensitivity(fit), correlated_sigma(fit.residual)
    )
    short = _too_short(fit, lag_s, refresh_s(record))
    reasons = [short or reason for reason in identifiability.reasons]
    first = _or_refused(lag, reasons[-1])
    published = map(_at_zero, SECOND_ORDER[1:], values)
    return [first, *(_or_refused(v, r) for v, r in zip(published, reasons, strict=True))]


def _or_refused(value: ParameterValue, reason: str) -> ParameterValue:
    if not reason:
        return value
    return ParameterValue(value.name, np.nan, ParameterStatus.REFUSED, reason)


def _too_short(fit: Extended, lag_s: float, refresh: float) -> str:
    """Return why a lag cannot be distinguished from none, empty where it can."""
    if lag_s > refresh:
        return ""
    rising, falling = fit.parameters[:2]
    return (
        f"velocity_lag {lag_s:.2g} s is shorter than the {refresh:.2g} s between two values of "
        "the command: stiffness and damping are not told apart; known: stiffness_rising/damping = "
        f"{rising:.4g}, stiffness_falling/damping = {falling:.4g}"
    )


def _at_zero(name: str, value: float) -> ParameterValue:
    if value > 0.0:
        return ParameterValue(name, float(value))
    return ParameterValue(name, 0.0, ParameterStatus.AT_BOUND, "rests on its bound 0")


def _sensitivity(fit: Extended) -> FloatArray:
    """Return what stiffness both ways and damping do beyond all other parameters: (N, 3)."""
    lag = float(fit.parameters[LAG])
    rising, falling, by_lag = (column(fit, i) for i in (0, 1, LAG))
    by_rates = rising * fit.parameters[0] + falling * fit.parameters[1]
    own = np.column_stack([rising * lag, falling * lag, -(by_rates + by_lag * lag) * lag])
    others = [column(fit, i) for i in fit.free if i not in (0, 1, LAG)]
    rest = np.array([c for c in others if np.linalg.norm(c) > 0.0])
    if not len(rest):
        return own
    base, _ = np.linalg.qr(rest.T)
    return np.asarray(own - base @ (base.T @ own))
