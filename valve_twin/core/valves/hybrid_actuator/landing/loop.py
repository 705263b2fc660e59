# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The controller that sets the armature down softly as the drive of the simulated actuator.

Stroke after stroke, with what it remembers behind the plant's state. Its data sheet is that of the
valve when the simulation began: a valve that ages does not tell its controller.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.control.current_loop import CurrentSensor, shown_current
from valve_twin.core.simulation.noise import normal_at
from valve_twin.core.valves.hybrid_actuator import plant_kernel as at
from valve_twin.core.valves.hybrid_actuator.landing import kernel
from valve_twin.core.valves.hybrid_actuator.landing.kernel import Gains, control
from valve_twin.core.valves.hybrid_actuator.magnetics import Magnetics, force
from valve_twin.core.valves.hybrid_actuator.plant_kernel import Armature, solenoid_currents, step
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.simulation.plant import Forcing, Response
    from valve_twin.core.types import FloatArray

MEMORY = at.STATE_SIZE
"""First place of what the controller remembers (`kernel.SIZE` numbers)."""

PULL, READ = MEMORY + kernel.SIZE, MEMORY + kernel.SIZE + 1
"""Net force of both solenoids by the data sheet in the last sample, towards the wanted seat [N];
last x that was read [m]."""

DATA_SHEET = READ + 1
"""First place of the data sheet: fields of `Armature`, those of `Magnetics`, the supply [V]."""

LANDING_SIZE = DATA_SHEET + len(Armature._fields) + len(Magnetics._fields) + 1
"""The plant's state with all of it behind [SI]."""

_LONG_AGO = 3600.0  # since the armature sat down, at rest [s]


class Drive(NamedTuple):
    """Numbers of the drive that the controller's own do not say.

    Attributes
    ----------
    ticks, steps : int
        Samples of the controller in one of the log; steps of the integration in one of these.
    step_s, supply, noise, lasts : float
        Step [s], true supply [V], noise of the position that is read [m], after which a stroke is
        given up [s].
    seed : int
        Of the noise.
    """

    ticks: int
    steps: int
    step_s: float
    supply: float
    noise: float
    lasts: float
    seed: int


def at_rest(
    state: FloatArray, armature: Armature, magnetics: Magnetics, supply: float
) -> FloatArray:
    """Return a plant's state with a controller that has seen it on the closed seat for long.

    Parameters
    ----------
    state : (STATE_SIZE,) array
        See `STATE_SIZE` of the plant [SI].
    armature, magnetics, supply : Armature, Magnetics, float
        The data sheet, supply in [V].

    Returns
    -------
    (LANDING_SIZE,) array
        State of plant and drive.
    """
    found = np.zeros(LANDING_SIZE)
    found[: at.STATE_SIZE] = state
    memory = found[MEMORY:PULL]
    memory[kernel.Y] = armature.travel
    memory[kernel.PHASE], memory[kernel.SINCE] = kernel.SEATED, _LONG_AGO
    found[READ] = state[at.X]
    found[DATA_SHEET:] = (*map(float, armature), *map(float, magnetics), supply)
    return found


def data_sheet(state: FloatArray) -> tuple[Armature, Magnetics, float]:
    """Return the data sheet of the controller, supply in [V].

    Parameters
    ----------
    state : (LANDING_SIZE,) array
        State of plant and drive.
    """
    numbers = [float(value) for value in state[DATA_SHEET:]]
    end = len(Armature._fields)
    armature = Armature._make(numbers[:end])._replace(blocks=bool(numbers[end - 2]))
    magnetics = Magnetics._make(numbers[end:-1])._replace(kernel=int(numbers[end]))
    return armature, magnetics, numbers[-1]


@njit(cache=True)
def _turn(state: FloatArray, way: float) -> None:
    """Let the controller begin a stroke: what it knows is told towards the other seat now."""
    c = state[MEMORY:PULL]
    sat = c[kernel.PHASE] == kernel.SEATED
    c[kernel.Y] = way * state[READ]
    c[kernel.V] = 0.0 if sat else -c[kernel.V]
    c[kernel.D] = 0.0 if sat else -c[kernel.D]
    c[kernel.PHASE], c[kernel.SINCE] = kernel.RELEASE, 0.0
    c[kernel.V_CATCH], c[kernel.V_RELEASE] = c[kernel.V_RELEASE], c[kernel.V_CATCH]
    state[PULL] *= -1.0


@njit(cache=True)
def _tick(
    state: FloatArray,
    known: tuple[Armature, Magnetics],
    g: Gains,
    d: Drive,
    sensor: CurrentSensor,
    currents: tuple[float, float],
    frozen: bool,
) -> tuple[float, float]:
    """Let the controller see a sample; return the shares of the supply that act in it [1]."""
    a, m = known
    c, opens = state[MEMORY:PULL], state[at.TARGET] > 0.5
    way = 1.0 if opens else -1.0
    if not frozen:
        state[READ] = state[at.X]
        if d.noise > 0.0:
            state[READ] += d.noise * normal_at(d.seed, round(state[at.TIME] / g.period))
    shown = (shown_current(sensor, currents[0]) * sensor.scale,
             shown_current(sensor, currents[1]) * sensor.scale)  # fmt: skip
    resistances = (a.resistance_opener, a.resistance_closer)
    if not opens:
        shown, resistances = (shown[1], shown[0]), (resistances[1], resistances[0])
    act = (c[kernel.V_CATCH] / g.supply, c[kernel.V_RELEASE] / g.supply)
    volts = control(c, g, a, m, way * state[READ], shown, resistances, state[PULL])
    c[kernel.V_CATCH], c[kernel.V_RELEASE] = volts
    y, reach = min(max(c[kernel.Y], -a.travel), a.travel), a.travel + a.residual_gap
    state[PULL] = force(m, shown[0], reach - y) - force(m, shown[1], reach + y)
    if c[kernel.PHASE] != kernel.SEATED and state[at.SINCE] > d.lasts:
        c[kernel.PHASE], c[kernel.SINCE] = kernel.SEATED, _LONG_AGO
    state[at.SINCE] += g.period
    return act if opens else (act[1], act[0])


@njit(cache=True)
def run_landing(
    state: FloatArray,
    true: tuple[Armature, Magnetics],
    known: tuple[Armature, Magnetics],
    g: Gains,
    d: Drive,
    forcing: Forcing,
    sensor: CurrentSensor,
    out: Response,
) -> None:
    """Run N samples in place; where the controller samples faster, voltages are means.

    Parameters
    ----------
    state : (LANDING_SIZE,) array
        See `LANDING_SIZE`; written in place [SI].
    true, known : tuple
        Armature and solenoid as they are; those of the data sheet.
    g, d : Gains, Drive
        Numbers of controller and drive.
    forcing : Forcing
        What acts on it; the reference is 0 closed, 1 open. Where the sensor freezes, the
        controller goes on with the last position it has read.
    sensor : CurrentSensor
        Of either coil.
    out : Response
        Overwritten: position (N,), voltages and currents (N, 4) at the stamps [1].
    """
    a, m = true
    work, plant = state[:8].copy(), state[: at.STATE_SIZE]
    target, _, _, _, disturbance, _, stuck, frozen, freezes, _ = forcing
    position, inputs = out
    for n in range(len(position)):
        wanted = 1.0 if target[n] > 0.5 else 0.0
        if wanted != state[at.TARGET]:
            state[at.TARGET], state[at.SINCE] = wanted, 0.0
            _turn(state, 1.0 if wanted > 0.5 else -1.0)
        position[n] = state[at.POSITION] if state[at.FAILED] == 0.0 else math.nan
        currents = solenoid_currents(a, m, m, plant)
        for j in range(2):
            inputs[n, j] = 0.0
            inputs[n, 2 + j] = shown_current(sensor, currents[j])
        if disturbance[n] != 0.0 and state[at.SPEED] != 0.0 and not stuck:
            moved = state[at.X] + 2.0 * a.travel * disturbance[n]
            state[at.X] = min(max(moved, -a.travel), a.travel)
        for _ in range(d.ticks):
            currents = solenoid_currents(a, m, m, plant)
            shares = _tick(state, known, g, d, sensor, currents, frozen or freezes[n])
            volts = (shares[0] * d.supply, shares[1] * d.supply)
            for j in range(2):
                inputs[n, j] += shares[j] / d.ticks
            for _ in range(d.steps):
                step(plant, a, m, m, volts, d.step_s, stuck, work)
