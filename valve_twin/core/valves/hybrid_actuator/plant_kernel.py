# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled motion of the actuator: two coils in flux linkage, an armature between two stops.

    dlam/dt = V - R i (each coil)    m dv/dt = F_opener - F_closer + F_gas - c v - k x    dx/dt = v

Classic Runge-Kutta of order 4 with a fixed step; the instant at which the armature meets a stop is
found inside the step, there the speed turns round by the restitution. What goes in and what is
lost is integrated with the same steps, so the energy balance can be checked.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from valve_twin.core.control.current_loop import CurrentSensor, shown_current
from valve_twin.core.valves.hybrid_actuator.magnetics import (
    Magnetics,
    coil_current,
    field_energy,
    force,
    magnet_flux,
)
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.simulation.plant import Forcing, Response
    from valve_twin.core.types import FloatArray

POSITION, X, SPEED, FLUX_OPENER, FLUX_CLOSER = 0, 1, 2, 3, 4
INPUT, JOULE, FRICTION, GAS, IMPACT = 5, 6, 7, 8, 9
OPEN_OPENER, OPEN_CLOSER, TARGET, SINCE, FAILED, TIME = 10, 11, 12, 13, 14, 15
STATE_SIZE = 16
"""Position [1]; x [m], speed [m/s], flux linkages [Wb]; energy put in, lost in the coils, lost in
friction, done by the gas, lost in impacts [J]; whether each bridge blocks (1 = no current flows);
target of the sequencer, time since it changed [s]; 1 after a value that is not finite; time
[s]."""

_MAX_IMPACTS = 16  # impacts in one step, then the armature rests
_BISECTIONS = 60
_REST_SPEED = 1e-4  # slower than this after an impact is rest [m/s], assumed
_RUB_SPEED = 1e-2  # over which Coulomb friction turns [m/s], assumed
_NO_CURRENT = 1e-3  # below this a bridge that is off blocks [A], assumed


class Armature(NamedTuple):
    """Numbers of the moving parts and of the drive, SI units."""

    mass: float
    spring: float
    damping: float
    travel: float
    residual_gap: float
    restitution: float
    gas_force: float
    gas_length: float
    resistance_opener: float
    resistance_closer: float
    blocks: bool
    coulomb: float


class Clock(NamedTuple):
    """Steps in a sample and their length [s]."""

    steps: int
    step_s: float


class Bridge(NamedTuple):
    """Numbers of the sequencer of the two bridges."""

    supply: float
    release: float
    catch: float
    release_s: float
    catch_start_s: float
    catch_s: float


@njit(cache=True)
def rubbing(a: Armature, v: float) -> float:
    """Return viscous damping and Coulomb friction at a speed [N]."""
    if a.coulomb == 0.0:
        return a.damping * v
    return a.damping * v + a.coulomb * math.tanh(v / _RUB_SPEED)


@njit(cache=True)
def gas_force(a: Armature, x: float) -> float:
    """Return the force of the gas on the valve, towards closed is negative [N]."""
    if a.gas_force == 0.0:
        return 0.0
    return -a.gas_force * math.exp(-(x + a.travel) / a.gas_length)


@njit(cache=True)
def net_force(
    a: Armature, opener: Magnetics, closer: Magnetics, x: float, i_o: float, i_c: float
) -> float:
    """Return the force on the armature at rest, opening is positive [N].

    Parameters
    ----------
    a, opener, closer : Armature, Magnetics, Magnetics
        Numbers of the actuator.
    x : float
        Position, 0 = middle, opening is positive [m].
    i_o, i_c : float
        Currents in opener and closer [A].
    """
    towards_open = force(opener, i_o, a.travel + a.residual_gap - x)
    towards_closed = force(closer, i_c, a.travel + a.residual_gap + x)
    return towards_open - towards_closed + gas_force(a, x) - a.spring * x


@njit(cache=True)
def _slopes(
    a: Armature,
    opener: Magnetics,
    closer: Magnetics,
    s: tuple[float, float, float, float],
    volts: tuple[float, float],
    blocked: tuple[bool, bool],
    free: bool,
) -> tuple[float, float, float, float, float, float, float, float]:
    x, v, lam_o, lam_c = s
    reach = a.travel + a.residual_gap
    i_o = 0.0 if blocked[0] else coil_current(opener, lam_o, reach - x)
    i_c = 0.0 if blocked[1] else coil_current(closer, lam_c, reach + x)
    drop_o, drop_c = a.resistance_opener * i_o, a.resistance_closer * i_c
    d_o = 0.0 if blocked[0] else volts[0] - drop_o
    d_c = 0.0 if blocked[1] else volts[1] - drop_c
    put_in = volts[0] * i_o + volts[1] * i_c
    joule = drop_o * i_o + drop_c * i_c
    if not free:
        return 0.0, 0.0, d_o, d_c, put_in, joule, 0.0, 0.0
    against = rubbing(a, v)
    accel = (net_force(a, opener, closer, x, i_o, i_c) - against) / a.mass
    return v, accel, d_o, d_c, put_in, joule, against * v, gas_force(a, x) * v


@njit(cache=True)
def _runge_kutta(
    a: Armature,
    opener: Magnetics,
    closer: Magnetics,
    state: FloatArray,
    volts: tuple[float, float],
    free: bool,
    h: float,
    out: FloatArray,
) -> None:
    """Write x, v, fluxes and the four integrals after `h` seconds into `out` (8,)."""
    blocked = (state[OPEN_OPENER] > 0.0, state[OPEN_CLOSER] > 0.0)
    x, v = state[X], state[SPEED]
    lam_o, lam_c = state[FLUX_OPENER], state[FLUX_CLOSER]
    k1 = _slopes(a, opener, closer, (x, v, lam_o, lam_c), volts, blocked, free)
    g = 0.5 * h
    s = (x + g * k1[0], v + g * k1[1], lam_o + g * k1[2], lam_c + g * k1[3])
    k2 = _slopes(a, opener, closer, s, volts, blocked, free)
    s = (x + g * k2[0], v + g * k2[1], lam_o + g * k2[2], lam_c + g * k2[3])
    k3 = _slopes(a, opener, closer, s, volts, blocked, free)
    s = (x + h * k3[0], v + h * k3[1], lam_o + h * k3[2], lam_c + h * k3[3])
    k4 = _slopes(a, opener, closer, s, volts, blocked, free)
    for j in range(8):
        slope = (k1[j] + 2.0 * (k2[j] + k3[j]) + k4[j]) / 6.0
        out[j] = state[X + j] + h * slope


@njit(cache=True)
def solenoid_currents(
    a: Armature, opener: Magnetics, closer: Magnetics, state: FloatArray
) -> tuple[float, float]:
    """Return the currents of opener and closer [A].

    Parameters
    ----------
    a, opener, closer : Armature, Magnetics, Magnetics
        Numbers of the actuator.
    state : (STATE_SIZE,) array
        See `STATE_SIZE`.
    """
    reach = a.travel + a.residual_gap
    i_o = i_c = 0.0
    if state[OPEN_OPENER] == 0.0:
        i_o = coil_current(opener, state[FLUX_OPENER], reach - state[X])
    if state[OPEN_CLOSER] == 0.0:
        i_c = coil_current(closer, state[FLUX_CLOSER], reach + state[X])
    return i_o, i_c


@njit(cache=True)
def _held(a: Armature, opener: Magnetics, closer: Magnetics, state: FloatArray) -> bool:
    """Return whether the armature rests on a stop and is pressed onto it."""
    if state[SPEED] != 0.0 or abs(state[X]) < a.travel:
        return False
    i_o, i_c = solenoid_currents(a, opener, closer, state)
    return bool(net_force(a, opener, closer, state[X], i_o, i_c) * state[X] >= 0.0)


@njit(cache=True)
def _impact(a: Armature, state: FloatArray) -> None:
    """Turn the speed round at a stop; what is lost is counted."""
    state[X] = math.copysign(a.travel, state[X])
    before = state[SPEED]
    after = -a.restitution * before
    if abs(after) < _REST_SPEED:
        after = 0.0
    state[IMPACT] += 0.5 * a.mass * (before * before - after * after)
    state[SPEED] = after


@njit(cache=True)
def _block(
    a: Armature,
    opener: Magnetics,
    closer: Magnetics,
    state: FloatArray,
    volts: tuple[float, float],
    before: tuple[float, float],
) -> None:
    """Let a bridge that is off block once its current has died; keep its flux at the magnet's."""
    reach = a.travel + a.residual_gap
    now = solenoid_currents(a, opener, closer, state)
    for j in range(2):
        m = opener if j == 0 else closer
        gap = reach - state[X] if j == 0 else reach + state[X]
        flag, flux = OPEN_OPENER + j, FLUX_OPENER + j
        if volts[j] != 0.0:
            continue
        dead = abs(now[j]) < _NO_CURRENT or now[j] * before[j] <= 0.0
        if state[flag] == 0.0 and a.blocks and dead:
            bare = magnet_flux(m, gap)
            state[JOULE] += field_energy(m, state[flux], gap) - field_energy(m, bare, gap)
            state[flag] = 1.0
        if state[flag] > 0.0:
            state[flux] = magnet_flux(m, gap)


@njit(cache=True)
def step(
    state: FloatArray,
    a: Armature,
    opener: Magnetics,
    closer: Magnetics,
    volts: tuple[float, float],
    h: float,
    stuck: bool,
    work: FloatArray,
) -> None:
    """Advance the state (STATE_SIZE,) by `h` seconds under constant voltages.

    Parameters
    ----------
    state : (STATE_SIZE,) array
        See `STATE_SIZE`; written in place.
    a, opener, closer : Armature, Magnetics, Magnetics
        Numbers of the actuator.
    volts : tuple of float
        Voltage on opener and closer [V].
    h : float
        Step [s].
    stuck : bool
        The armature does not move.
    work : (8,) array
        Overwritten with the states from `X` on.
    """
    if state[FAILED] > 0.0:
        return
    state[TIME] += h
    for j in range(2):
        if volts[j] != 0.0:
            state[OPEN_OPENER + j] = 0.0
    before = solenoid_currents(a, opener, closer, state)
    left = h
    for impact in range(_MAX_IMPACTS + 1):
        if impact == _MAX_IMPACTS:
            state[IMPACT] += 0.5 * a.mass * state[SPEED] ** 2
            state[SPEED] = 0.0
        free = not (stuck or _held(a, opener, closer, state)) and impact < _MAX_IMPACTS
        if stuck:
            state[SPEED] = 0.0
        _runge_kutta(a, opener, closer, state, volts, free, left, work)
        if not free or abs(work[0]) <= a.travel:
            state[X : X + 8] = work
            break
        low, high = 0.0, left
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            _runge_kutta(a, opener, closer, state, volts, True, middle, work)
            if abs(work[0]) <= a.travel:
                low = middle
            else:
                high = middle
            if high - low < 1e-13 * h:
                break
        _runge_kutta(a, opener, closer, state, volts, True, high, work)
        state[X : X + 8] = work
        _impact(a, state)
        left -= high
    _block(a, opener, closer, state, volts, before)
    state[POSITION] = 0.5 * (state[X] / a.travel + 1.0)
    if not math.isfinite(state[X] + state[SPEED] + state[FLUX_OPENER] + state[FLUX_CLOSER]):
        state[FAILED] = 1.0


@njit(cache=True)
def stored_energy(state: FloatArray, a: Armature, opener: Magnetics, closer: Magnetics) -> float:
    """Return kinetic, spring, field and magnet energy [J].

    Parameters
    ----------
    state : (STATE_SIZE,) array
        See `STATE_SIZE`.
    a, opener, closer : Armature, Magnetics, Magnetics
        Numbers of the actuator.
    """
    reach = a.travel + a.residual_gap
    energy = 0.5 * (a.mass * state[SPEED] ** 2 + a.spring * state[X] ** 2)
    energy += field_energy(opener, state[FLUX_OPENER], reach - state[X])
    return float(energy + field_energy(closer, state[FLUX_CLOSER], reach + state[X]))


@njit(cache=True)
def follow(
    state: FloatArray,
    a: Armature,
    opener: Magnetics,
    closer: Magnetics,
    volts: FloatArray,
    h: float,
    stuck: bool,
    out: FloatArray,
) -> None:
    """Follow N steps under given voltages and check the balance of the energy.

    Parameters
    ----------
    state : (STATE_SIZE,) array
        See `STATE_SIZE`; written in place.
    a, opener, closer : Armature, Magnetics, Magnetics
        Numbers of the actuator.
    volts : (N, 2) array
        Voltage on opener and closer during each step [V].
    h : float
        Step [s].
    stuck : bool
        The armature does not move.
    out : (N, 4) array
        Overwritten with position [m], speed [m/s], stored energy [J] and what is missing in the
        balance since the first step [J].
    """
    work = state[:8].copy()
    first = stored_energy(state, a, opener, closer) - state[INPUT] - state[GAS]
    first += state[JOULE] + state[FRICTION] + state[IMPACT]
    for n in range(len(volts)):
        step(state, a, opener, closer, (volts[n, 0], volts[n, 1]), h, stuck, work)
        stored = stored_energy(state, a, opener, closer)
        balance = stored - state[INPUT] - state[GAS]
        balance += state[JOULE] + state[FRICTION] + state[IMPACT]
        out[n, 0], out[n, 1] = state[X], state[SPEED]
        out[n, 2], out[n, 3] = stored, balance - first


@njit(cache=True)
def _voltages(state: FloatArray, b: Bridge, target: float, period: float) -> tuple[float, float]:
    """Return what the sequencer puts on opener and closer, and let its time go on."""
    wanted = 1.0 if target > 0.5 else 0.0
    if wanted != state[TARGET]:
        state[TARGET] = wanted
        state[SINCE] = 0.0
    since = state[SINCE] + 0.25 * period
    state[SINCE] += period
    holding = catching = 0.0
    if since < b.release_s:
        holding = -b.release
    if b.catch_start_s <= since < b.catch_start_s + b.catch_s:
        catching = b.catch
    return (catching, holding) if wanted > 0.5 else (holding, catching)


@njit(cache=True)
def run_actuator(
    state: FloatArray,
    a: Armature,
    opener: Magnetics,
    closer: Magnetics,
    b: Bridge,
    clock: Clock,
    forcing: Forcing,
    sensor: CurrentSensor,
    out: Response,
) -> None:
    """Run N samples in place.

    Parameters
    ----------
    state : (STATE_SIZE,) array
        See `STATE_SIZE`; written in place.
    a, opener, closer, b : Armature, Magnetics, Magnetics, Bridge
        Numbers of actuator and drive.
    clock : Clock
        Steps of the integration.
    sensor : CurrentSensor
        Of either coil.
    forcing : Forcing
        What acts on it; the reference is 0 closed, 1 open, the commands from outside are the
        voltages as shares of the supply [1], and currents, which are ignored.
    out : Response
        Overwritten: position (N,), voltages and currents (N, 4) at the stamps [1].
    """
    work = state[:8].copy()
    steps, h = clock
    target, _, external, commands, disturbance, _, stuck, _, _, _ = forcing
    position, inputs = out
    for n in range(len(position)):
        if external:
            volts = (commands[n, 0] * b.supply, commands[n, 1] * b.supply)
        else:
            volts = _voltages(state, b, target[n], steps * h)
        position[n] = state[POSITION] if state[FAILED] == 0.0 else math.nan
        currents = solenoid_currents(a, opener, closer, state)
        for j in range(2):
            inputs[n, j] = volts[j] / b.supply
            inputs[n, 2 + j] = shown_current(sensor, currents[j])
        if disturbance[n] != 0.0 and state[SPEED] != 0.0 and not stuck:
            moved = state[X] + 2.0 * a.travel * disturbance[n]
            state[X] = min(max(moved, -a.travel), a.travel)
        for _ in range(steps):
            step(state, a, opener, closer, volts, h, stuck, work)
