# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Turn the fits of the stepper valve into published parameters: what is known, what not, why."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.data.robust import difference_sigma
from valve_twin.core.estimation.recursive.estimator import fits, identify
from valve_twin.core.types import ParameterStatus, ParameterValue
from valve_twin.core.valves.kit.outcome import at_bound, blank
from valve_twin.core.valves.stepper_servo.fit import (
    end_offset,
    fit_flow,
    fit_thread,
    flow_residual,
    spool_position,
    thread_residual,
)
from valve_twin.core.valves.stepper_servo.kernels import BACKLASH, DELAY, LOST
from valve_twin.core.valves.stepper_servo.parameters import EDGE, FITS, FLOW, THETA, THREAD
from valve_twin.core.valves.stepper_servo.record import rest_noise

if TYPE_CHECKING:
    from collections.abc import Iterable

    from valve_twin.core.estimation.recursive.estimator import Adaptation, Adapted, Structure
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.stepper_servo.fit import FlowFit, Record, ThreadFit

_LEAST = 5
"""Samples that must show a parameter, assumed."""

_THREAD_LEFT, _FLOW_LEFT = 5e-4, 9e-4
"""What corners of the sensor's average and of the meter leave of the position [1] and of the flow
over the full one [1]; measured on the simulated valve."""

_THREAD_MOST, _FLOW_MOST = 1.5e-3, 2e-3
"""Residual beyond these and the noise from which the structure is another one [1]."""

_BACKLASH_SHARE, _EDGE_SHARE, _FULL_SHARE = 0.4, 1.5, 0.2
"""Error of backlash, edges [1] and full flow [full flow] over that residual; the worst of soft
edges and of screws whose backlash varies."""

_BACKLASH_FLOOR, _FULL_FLOOR = 1.5e-4, 3e-4
"""Their errors on the simulated valve: a step takes a tenth of a sample [1]."""

_BACKLASH_PART = 4e-3
"""Error of the backlash over itself: it is 3.4e-3 too small where it is three times as large."""

_STAIR = 0.3
"""Error of the backlash once a step is lost [steps]: they go one by one, not as the even share
that is fitted; measured 0.28 at most with 0.5 to 10 % of the steps lost."""

_AFTER_BAD = 400  # samples behind one that cannot be used in which nothing is judged
_BAD_SHARE = 5e-3  # of such samples above which the structure is not judged at all [1]

_LEAST_WAY = 5.0
"""Steps upwards that show whether steps are lost, assumed."""


@dataclass(frozen=True, slots=True)
class Settings:
    """What the Hammerstein-Wiener model counts from, and how fast it follows.

    Attributes
    ----------
    centre : float
        Position that is its zero [1].
    offset : float
        Spool position minus counted motor position at the end of the cycle [1]: lost steps are no
        dynamics.
    adaptation : Adaptation
        How fast it follows.
    """

    centre: float
    offset: float
    adaptation: Adaptation


def mechanics(
    record: Record, period_s: float, *, step: float, max_backlash: float, max_delay: float
) -> tuple[tuple[ParameterValue, ...], ThreadFit]:
    """Return the parameters of thread and flow curve, in the order of `THREAD` and `FLOW`.

    Parameters
    ----------
    record : Record
        N samples without a gap.
    period_s : float
        Sampling time [s].
    step : float
        Travel of a full step [1].
    max_backlash, max_delay : float
        Upper bounds [1], [samples].
    """
    thread = fit_thread(record, max_backlash=max_backlash, max_delay=max_delay)
    noise = _position_noise(record, max(1, round(float(thread.parameters[DELAY]))))
    left = _beyond(thread_residual(record, thread), record, _THREAD_LEFT, noise)
    told = _thread(thread, period_s, step, max_backlash, left)
    return (*told, *_flow(record, thread, period_s)), thread


def _position_noise(record: Record, lag: int) -> float:
    """Return the noise of the position [1]: at rest, where it never rests of its differences."""
    noise = rest_noise(record, lag)
    return noise if np.isfinite(noise) else difference_sigma(np.diff(record.position, 3), 3)


def _beyond(residual: FloatArray, record: Record, own: float, noise: float) -> float:
    """Return what a fit leaves beyond noise and what it leaves of its own valve; 0 if unknown.

    Behind a sample that cannot be used the screw may stand elsewhere: what follows is left out.
    """
    if float(np.mean(~record.used)) > _BAD_SHARE:
        return 0.0
    bad = np.concatenate((np.zeros(_AFTER_BAD), np.cumsum(~record.used)))
    good = record.used & (bad[_AFTER_BAD:] == bad[:-_AFTER_BAD])
    if not good.any():
        return 0.0
    squares = float(np.mean(residual[good] ** 2)) - own**2 - noise**2
    return float(np.sqrt(squares)) if squares > 0.0 else 0.0


def _around(name: str, value: float, half: float) -> ParameterValue:
    """Return a value with what is wrong with it in every cycle alike, its scatter comes later."""
    return ParameterValue(name, value, lower_95=value - half, upper_95=value + half)


def _thread(
    fit: ThreadFit, period_s: float, step: float, max_backlash: float, left: float
) -> list[ParameterValue]:
    p = fit.parameters
    delay = ParameterValue(THREAD[4], float(p[DELAY]) * period_s)
    if min(fit.pushed_up, fit.pushed_down) < _LEAST:
        reason = (
            f"the screw pushed upwards in {fit.pushed_up} and downwards in {fit.pushed_down} "
            f"samples, fewer than {_LEAST}: no reversal shows the backlash"
        )
        return [*_unknown(THREAD[:4], reason), delay]
    gone = min(1.0, abs(float(p[LOST])) * fit.up / step)
    parts = (
        _BACKLASH_FLOOR,
        _BACKLASH_SHARE * left,
        _BACKLASH_PART * float(p[BACKLASH]),
        _STAIR * step * gone,
    )
    backlash = _around(THREAD[0], float(p[BACKLASH]), float(np.linalg.norm(parts)))
    if left > _THREAD_MOST:
        reason = (
            f"the play leaves {left:.2g} of the stroke beyond the noise, more than "
            f"{_THREAD_MOST:g}: the backlash varies along the screw, or the spool sticks"
        )
        (backlash,) = blank(THREAD[:1], reason)
    elif not 0.0 < p[BACKLASH] < max_backlash:
        backlash = at_bound(THREAD[0], float(p[BACKLASH]))
    offset = ParameterValue(THREAD[3], end_offset(fit))
    if fit.up < _LEAST_WAY * step:
        reason = f"{fit.up / step:.0f} steps upwards, fewer than {_LEAST_WAY:.0f}"
        lost = [*_unknown(THREAD[1:3], reason)]
    else:
        share = float(p[LOST])
        lost = [ParameterValue(THREAD[1], share), ParameterValue(THREAD[2], share * fit.up / step)]
    return [backlash, *lost, offset, delay]


def _flow(record: Record, thread: ThreadFit, period_s: float) -> list[ParameterValue]:
    if float(np.ptp(record.flow)) <= 0.0:
        return [*_unknown(FLOW, "the flow does not change: no meter?")]
    longest = max(1.0, 1.0 / period_s)
    spool = spool_position(record, thread)
    fit = fit_flow(record, spool, max_lag=longest)
    q = fit.parameters
    noise = difference_sigma(np.diff(record.flow, 3), 3)
    off = flow_residual(record, spool, fit)
    left = _beyond(off, record, _FLOW_LEFT * float(q[4]), noise) / float(q[4])
    if left > _FLOW_MOST:
        reason = (
            f"the flow leaves {left:.2g} of the full one, more than {_FLOW_MOST:g}: its edges are "
            "not sharp, its slopes not straight or the backlash varies along the screw"
        )
        return list(blank(FLOW, reason))
    edges = [
        _edge(name, float(q[i]), seen, left)
        for i, (name, seen) in enumerate(zip(FLOW[:2], (fit.on_lower, fit.on_upper), strict=True))
    ]
    half = float(np.hypot(2.0 * EDGE, 2.0 * _EDGE_SHARE * left))
    band = _around(FLOW[2], edges[1].value - edges[0].value, half)
    if not (edges[0].usable and edges[1].usable):
        (band,) = _unknown(FLOW[2:3], "one of its edges is not excited")
    return [*edges, band, _full(fit, left), ParameterValue(FLOW[4], float(q[5]) * period_s)]


def _edge(name: str, value: float, seen: int, left: float) -> ParameterValue:
    if seen < _LEAST:
        return _unknown((name,), f"{seen} samples on its slope, fewer than {_LEAST}")[0]
    return _around(name, value, float(np.hypot(EDGE, _EDGE_SHARE * left)))


def _full(fit: FlowFit, left: float) -> ParameterValue:
    full = float(fit.parameters[4])
    return _around(FLOW[3], full, full * float(np.hypot(_FULL_FLOOR, _FULL_SHARE * left)))


def _unknown(names: Iterable[str], reason: str) -> tuple[ParameterValue, ...]:
    return blank(names, reason, ParameterStatus.NOT_EXCITED)


def wiener(
    record: Record, structure: Structure, theta: FloatArray | None, settings: Settings
) -> tuple[tuple[ParameterValue, ...], Adapted]:
    """Return the Hammerstein-Wiener parameters (`THETA`), the offset and the `FITS`.

    Parameters
    ----------
    record : Record
        N samples without a gap.
    structure : Structure
        Orders.
    theta : (P,) array or None
        Where to start: what the cycle before gave [1]. The adaptation gain starts anew in each
        cycle, so that the parameters can follow for months.
    settings : Settings
        Centre, offset and adaptation.
    """
    y = record.position - settings.centre
    u = record.motor + settings.offset - settings.centre
    y = np.where(record.used, y, np.nan)
    got = identify(structure, y, u, adaptation=settings.adaptation, theta=theta)
    known = dict(zip(structure.names, got.state.theta.tolist(), strict=True))
    values = [ParameterValue(name, float(known.get(name, 0.0))) for name in THETA]
    radius = float(np.abs(np.roots([1.0, *got.state.theta[: structure.na]])).max())
    shown = fits(structure, got, np.where(record.used, y, 0.0), u, skip=0)
    three = (shown.a_priori, shown.a_posteriori, shown.free_run, radius)
    named = zip(FITS, three, strict=True)
    offset = ParameterValue(THREAD[3], settings.offset)
    return (*values, offset, *(ParameterValue(name, float(v)) for name, v in named)), got
