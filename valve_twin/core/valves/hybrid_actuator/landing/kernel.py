# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled controller that sets the armature down softly, and its loop with the plant.

Every sample position and both currents are measured; the voltages computed from them act one
sample later. All of it is told towards the seat that is wanted: y = x for an opening, -x for a
closing, s = distance to that seat.

    observer    y, v and the force d that the data sheet does not know, from y and the currents
    profile     v_r(s): a constant deceleration in front of the seat, further out the springs' own
    force       F = m (dv_r/dt + gain (v_r - v)) + k y + c v - d + force of the other solenoid
    current     that gives F at the gap, by the data sheet's kernel; inverse where the magnet alone
                pulls more
    voltage     that brings the flux linkage there within a sample

The controller knows the data sheet and nothing of the true friction, supply and gas.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.control.current_loop import CurrentSensor, shown_current
from valve_twin.core.valves.hybrid_actuator.magnetics import (
    Magnetics,
    coil_current,
    flux_linkage,
    force,
    magnet_force,
)
from valve_twin.core.valves.hybrid_actuator.plant_kernel import (
    IMPACT,
    SPEED,
    TIME,
    Armature,
    X,
    solenoid_currents,
    step,
)
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

RELEASE, FLIGHT, SEATED = 0, 1, 2
"""Phases: the other coil lets go, its current is off, the armature sits."""

Y, V, D, PHASE, SINCE, V_CATCH, V_RELEASE = 0, 1, 2, 3, 4, 5, 6
SIZE = 7
"""Place [m], speed [m/s], unknown force [N]; phase; time near the seat [s]; voltages on the coil
that catches and on the one that releases, of the sample that runs [V]."""

_HALVINGS = 30  # of an interval of currents: 1e-9 of it is left
_DEAD = 0.5  # below this a coil that is wanted off gets no voltage [A], assumed


class Gains(NamedTuple):
    """Numbers of the controller, SI units; see `LandingNumbers`."""

    period: float
    seat_speed: float
    deceleration: float
    growth: float
    zone: float
    speed_gain: float
    observer: float
    most_current: float
    catch_from: float
    inverse_below: float
    release_until: float
    reserve: float
    near: float
    ramp: float
    supply: float


@njit(cache=True)
def profile(g: Gains, a: Armature, s: float) -> tuple[float, float]:
    """Return the wanted speed [m/s] and acceleration [m/s^2] at a distance from the seat.

    Parameters
    ----------
    g, a : Gains, Armature
        Numbers of controller and data sheet.
    s : float
        Distance, below 0 = 0 [m].
    """
    if s <= 0.0:
        return g.seat_speed, 0.0
    near = min(s, g.zone)
    square = g.seat_speed**2 + (2.0 * g.deceleration + g.growth * near) * near
    if s < g.zone:
        return math.sqrt(square), -g.deceleration - g.growth * s
    stiff = a.spring / a.mass
    y, edge = a.travel - s, a.travel - g.zone
    return math.sqrt(max(square + stiff * (edge * edge - y * y), 0.0)), -stiff * y


@njit(cache=True)
def weakest_current(m: Magnetics, gap: float) -> float:
    """Return the inverse current at which the linear kernel pulls least, not above 0 [A].

    The saturating kernel pulls less still beyond it: up to here any kernel's pull falls.

    Parameters
    ----------
    m, gap : Magnetics, float
        The solenoid, and the gap [m].
    """
    return -m.coupling * math.sqrt(magnet_force(m, gap) / m.beta) * (gap + m.kappa)


@njit(cache=True)
def current_for(
    m: Magnetics, wanted: float, gap: float, most: float, inverse_below: float
) -> float:
    """Return the current at which a solenoid pulls with a force, within what it can [A].

    Parameters
    ----------
    m : Magnetics
        The solenoid.
    wanted, gap, most : float
        Force [N], gap [m], largest current [A].
    inverse_below : float
        Gap below which an inverse current is worth its heat [m].
    """
    low = max(weakest_current(m, gap), -most) if gap < inverse_below else 0.0
    high = most
    if force(m, low, gap) >= wanted:
        return low
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if force(m, middle, gap) < wanted:
            low = middle
        else:
            high = middle
    return high


@njit(cache=True)
def _observe(c: FloatArray, g: Gains, a: Armature, pull: float, shown: float) -> None:
    """Let the observer see a position, one sample after the last; `pull` acted meanwhile [N]."""
    h = g.period
    pole = math.exp(-g.observer * h)
    accel = (pull - a.spring * c[Y] - a.damping * c[V] + c[D]) / a.mass
    place = c[Y] + h * c[V] + 0.5 * h * h * accel
    off = shown - place
    c[Y] = place + (1.0 - pole**3) * off
    c[V] += h * accel + 1.5 * (1.0 - pole) ** 2 * (1.0 + pole) / h * off
    c[D] += a.mass * (1.0 - pole) ** 3 / (h * h) * off


@njit(cache=True)
def _volts(m: Magnetics, wanted: float, flux: float, gap: float, drop: float, g: Gains) -> float:
    """Return the voltage that brings a coil to a current within a sample [V]."""
    volts = drop + (flux_linkage(m, wanted, gap) - flux) / g.period
    return float(min(max(volts, -g.supply), g.supply))


@njit(cache=True)
def control(
    c: FloatArray,
    g: Gains,
    a: Armature,
    m: Magnetics,
    shown: float,
    currents: tuple[float, float],
    resistances: tuple[float, float],
    pull: float,
) -> tuple[float, float]:
    """Return the voltages of the next sample, on the coil that catches and on the other [V].

    Parameters
    ----------
    c : (SIZE,) array
        See `SIZE`; written in place.
    g, a, m : Gains, Armature, Magnetics
        Numbers of controller and data sheet.
    shown : float
        Measured y [m].
    currents, resistances : tuple of float
        Measured currents [A] and resistances [ohm] of both coils, the catching one first.
    pull : float
        Net force of both solenoids in the sample that has passed, by the data sheet [N].
    """
    _observe(c, g, a, pull, shown)
    h, reach = g.period, a.travel + a.residual_gap
    # where all will be when the voltages begin to act
    i_c, i_r = currents
    y_now = min(max(c[Y], -a.travel), a.travel)
    flux_c = flux_linkage(m, i_c, reach - y_now) + h * (c[V_CATCH] - resistances[0] * i_c)
    flux_r = flux_linkage(m, i_r, reach + y_now) + h * (c[V_RELEASE] - resistances[1] * i_r)
    y = min(max(c[Y] + h * c[V], -a.travel), a.travel)
    gap_c, gap_r = reach - y, reach + y
    i_c, i_r = coil_current(m, flux_c, gap_c), coil_current(m, flux_r, gap_r)
    s = a.travel - y
    # the coil that lets go
    wanted_r = 0.0
    v_r, a_r = profile(g, a, s)
    if c[PHASE] == RELEASE:
        wanted_r = weakest_current(m, gap_r)
        enough = c[V] > 0.0 and c[V] * c[V] >= v_r * v_r + g.reserve
        if 2.0 * a.travel - s > g.release_until or enough:
            c[PHASE] = FLIGHT
            wanted_r = 0.0
    # the coil that catches
    wanted = a.mass * (a_r + g.speed_gain * (v_r - c[V])) + a.spring * y + a.damping * c[V]
    wanted += force(m, i_r, gap_r) - c[D]
    wanted_c = 0.0
    if s < g.catch_from:
        wanted_c = current_for(m, wanted, gap_c, g.most_current, g.inverse_below)
    if c[PHASE] == SEATED:
        c[SINCE] += h
        wanted_c = max(1.0 - c[SINCE] / g.ramp, 0.0) * min(wanted_c, 0.0)
    else:
        c[SINCE] = c[SINCE] + h if s < g.near else 0.0
        if c[SINCE] * g.seat_speed > g.near:
            c[PHASE], c[SINCE] = SEATED, 0.0
    volts_c = volts_r = 0.0
    if wanted_c != 0.0 or abs(i_c) > _DEAD:
        volts_c = _volts(m, wanted_c, flux_c, reach - min(y + h * c[V], a.travel),
                         resistances[0] * i_c, g)  # fmt: skip
    if wanted_r != 0.0 or abs(i_r) > _DEAD:
        volts_r = _volts(m, wanted_r, flux_r, gap_r, resistances[1] * i_r, g)
    return volts_c, volts_r


@njit(cache=True)
def _advance(
    state: FloatArray,
    true: tuple[Armature, Magnetics],
    volts: tuple[float, float],
    steps: int,
    h: float,
    way: float,
    contact: FloatArray,
) -> None:
    """Advance the plant and note the first contact with the wanted seat."""
    a, m = true
    work = state[:8].copy()
    kept = 2.0 / (a.mass * (1.0 - a.restitution**2))
    for _ in range(steps):
        lost = state[IMPACT]
        step(state, a, m, m, volts if way > 0.0 else (volts[1], volts[0]), h, False, work)
        if state[IMPACT] > lost and way * state[X] > 0.0 and math.isnan(contact[0]):
            contact[0] = math.sqrt((state[IMPACT] - lost) * kept)
            contact[1] = state[TIME]


@njit(cache=True)
def throw(
    state: FloatArray,
    true: tuple[Armature, Magnetics],
    volts: FloatArray,
    h: float,
    opens: bool,
    out: FloatArray,
) -> tuple[float, float]:
    """Run one stroke under given voltages; return speed and time of the first contact.

    Parameters
    ----------
    state : (STATE_SIZE,) array
        See `STATE_SIZE` of the plant: seated on the other side; written in place.
    true : tuple
        Armature and solenoid as they are.
    volts : (N, 2) array
        Voltage on the coil that catches and on the other during each step [V].
    h : float
        Step [s].
    opens : bool
        Whether it opens, else it closes.
    out : (N,) array
        Overwritten with y before each step [m].

    Returns
    -------
    speed, time : float
        Of the first contact with the wanted seat [m/s], [s]; NaN = never.
    """
    way = 1.0 if opens else -1.0
    contact = np.full(2, np.nan)
    for n in range(len(volts)):
        out[n] = way * state[X]
        _advance(state, true, (volts[n, 0], volts[n, 1]), 1, h, way, contact)
    return contact[0], contact[1]


@njit(cache=True)
def fly(
    state: FloatArray,
    true: tuple[Armature, Magnetics, float],
    known: tuple[Armature, Magnetics],
    g: Gains,
    noise: FloatArray,
    sensor: CurrentSensor,
    steps: int,
    opens: bool,
    out: FloatArray,
) -> tuple[float, float]:
    """Run one stroke under the controller; return speed and time of the first contact.

    Parameters
    ----------
    state : (STATE_SIZE,) array
        See `STATE_SIZE` of the plant: seated on the other side; written in place.
    true, known : tuple
        Armature, solenoid and supply [V] as they are; armature and solenoid of the data sheet.
    g : Gains
        Numbers of the controller.
    noise : (N,) array
        Error of the position sensor in each sample [m].
    sensor : CurrentSensor
        Of either coil.
    steps : int
        Steps of the integration in a sample.
    opens : bool
        Whether it opens, else it closes.
    out : (N, 4) array
        Overwritten: y [m], speed towards the seat [m/s], currents of the coil that catches and of
        the other [A].

    Returns
    -------
    speed, time : float
        Of the first contact with the wanted seat [m/s], [s]; NaN = never.
    """
    a, m, supply = true
    a0, m0 = known
    way = 1.0 if opens else -1.0
    resistances = (a0.resistance_opener, a0.resistance_closer)
    if not opens:
        resistances = (a0.resistance_closer, a0.resistance_opener)
    c, contact = np.zeros(SIZE), np.full(2, np.nan)
    c[Y] = -a0.travel
    pull, reach0 = 0.0, a0.travel + a0.residual_gap
    for n in range(len(noise)):
        both = solenoid_currents(a, m, m, state)
        if not opens:
            both = (both[1], both[0])
        out[n, 0], out[n, 1] = way * state[X], way * state[SPEED]
        out[n, 2], out[n, 3] = both
        shown = (shown_current(sensor, both[0]) * sensor.scale,
                 shown_current(sensor, both[1]) * sensor.scale)  # fmt: skip
        volts = control(c, g, a0, m0, out[n, 0] + noise[n], shown, resistances, pull)
        at = min(max(c[Y], -a0.travel), a0.travel)
        pull = force(m0, shown[0], reach0 - at) - force(m0, shown[1], reach0 + at)
        # what was computed a sample ago acts now, at the true supply
        act = (c[V_CATCH] * supply / g.supply, c[V_RELEASE] * supply / g.supply)
        _advance(state, (a, m), act, steps, g.period / steps, way, contact)
        c[V_CATCH], c[V_RELEASE] = volts
    return contact[0], contact[1]
