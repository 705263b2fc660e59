# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The valve in its position loop: trajectory set control or the nonlinear PID, at 10 kHz."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from valve_twin.core.control.current_loop import (
    SUB_STEPS,
    CurrentGains,
    CurrentSensor,
    shown_current,
)
from valve_twin.core.control.nonlinear_pid import PidGains, pid_output
from valve_twin.core.control.trajectory_set import (
    MODEL_STEPS,
    TrajectoryWeights,
    candidate,
    end_cost,
    error_cost,
)
from valve_twin.core.valves.double_solenoid import plant_kernel as at
from valve_twin.core.valves.double_solenoid.control.observer import Observer, correct, follow
from valve_twin.core.valves.double_solenoid.plant_kernel import (
    Valve,
    control_sample,
    predict_sample,
)
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.physics.curves import Curves
    from valve_twin.core.simulation.plant import Forcing, Response
    from valve_twin.core.types import FloatArray

PID, TRAJECTORY_SET = 0, 1
CONTROLS = ("pid", "trajectory_set")

N_INPUTS = 5
"""Setpoint, voltages of A and B, currents of A and B."""


class Controller(NamedTuple):
    """Position controller: PID or TRAJECTORY_SET, and the numbers of both.

    `known` and `observer` serve the trajectory set: its model of the valve, what observes it.
    """

    kind: int
    pid: PidGains
    weights: TrajectoryWeights
    known: Valve
    observer: Observer


@njit(cache=True)
def decide(
    s: FloatArray,
    v: Valve,
    m: Curves,
    g: CurrentGains,
    w: TrajectoryWeights,
    wanted: float,
    work: FloatArray,
) -> float:
    """Return the best input of the trajectory set [1].

    Parameters
    ----------
    s : (STATE_SIZE,) array
        State of the valve, see `STATE_SIZE`; not changed.
    v, m, g, w : Valve, Curves, CurrentGains, TrajectoryWeights
        Model of the valve with its current controllers; weights.
    wanted : float
        Wanted position [m].
    work : (STATE_SIZE,) array
        Overwritten with states, see `STATE_SIZE`.
    """
    last = s[at.COMMAND]
    per_half = 1.0 / v.half_stroke
    first = (wanted - s[at.X]) * per_half
    best, lowest = last, math.inf
    for k in range(2 * w.sizes + 3):
        u = candidate(w, k, last)
        for j in range(at.STATE_SIZE):
            work[j] = s[j]
        cost = 0.0
        for _ in range(w.horizon):
            predict_sample(work, v, m, g, u, MODEL_STEPS)
            cost += error_cost(w, first, (wanted - work[at.X]) * per_half)
        cost = cost / w.horizon + end_cost(w, work[at.SPEED] * per_half, u - last)
        if cost < lowest:
            best, lowest = u, cost
    return float(best)


@njit(cache=True)
def decide_all(
    s: FloatArray,
    v: Valve,
    m: Curves,
    g: CurrentGains,
    w: TrajectoryWeights,
    wanted: FloatArray,
    out: FloatArray,
) -> None:
    """Write the decision for each of N wanted positions from one state, for studies.

    Parameters
    ----------
    s, v, m, g, w : (STATE_SIZE,) array, Valve, Curves, CurrentGains, TrajectoryWeights
        As in `decide`.
    wanted : (N,) array
        Wanted positions [m].
    out : (N,) array
        Overwritten with inputs [1].
    """
    work = s.copy()
    for n in range(len(wanted)):
        out[n] = decide(s, v, m, g, w, wanted[n], work)


@njit(cache=True)
def run_valve(
    s: FloatArray,
    v: Valve,
    m: Curves,
    g: CurrentGains,
    controller: Controller,
    forcing: Forcing,
    sensor: CurrentSensor,
    samples: int,
    out: Response,
) -> None:
    """Run N samples of `samples` control samples each, in place.

    Parameters
    ----------
    s : (2 STATE_SIZE,) array
        The valve's state, see `STATE_SIZE`, then that of the observer; written in place.
    v, m, g, controller : Valve, Curves, CurrentGains, Controller
        Numbers of valve and controllers.
    forcing : Forcing
        What acts on it; the reference, or the first command from outside, is the setpoint [1].
        Where the sensor freezes, the controller goes on with the last position it has read.
    sensor : CurrentSensor
        Of either coil.
    samples : int
        Control samples in a sample.
    out : Response
        Overwritten: position (N,) [1]; setpoint, means of voltages and currents over the sample
        before (N, N_INPUTS) [1].
    """
    o = s[at.STATE_SIZE :]
    work = o.copy()
    reference, _, external, commands, disturbance, _, stuck, frozen, _, _ = forcing
    position, inputs = out
    for n in range(len(position)):
        wanted = commands[n, 0] if external else reference[n]
        position[n] = s[at.POSITION] if s[at.FAILED] == 0.0 else math.nan
        inputs[n, 0] = wanted
        for j in range(2):
            inputs[n, 1 + j] = s[at.LOG_VOLTS_A + j] / g.supply
            inputs[n, 3 + j] = shown_current(sensor, s[at.LOG_A + j])
        s[at.LOG_VOLTS_A] = s[at.LOG_VOLTS_B] = s[at.LOG_A] = s[at.LOG_B] = 0.0
        if disturbance[n] != 0.0 and s[at.SPEED] != 0.0 and not stuck:
            moved = s[at.X] + 2.0 * v.half_stroke * disturbance[n]
            s[at.X] = min(max(moved, -v.stop), v.stop)
        target = (2.0 * wanted - 1.0) * v.half_stroke
        for _ in range(samples):
            if s[at.FAILED] != 0.0:
                break
            read = s[at.READ] if frozen else s[at.X]
            if controller.kind == TRAJECTORY_SET:
                correct(o, controller.known, m, controller.observer, s, read)
                command = decide(o, controller.known, m, g, controller.weights, target, work)
            else:
                speed = (read - s[at.READ]) / (v.half_stroke * at.SAMPLE_S)
                error = (target - read) / v.half_stroke
                command, s[at.PID_INTEGRAL] = pid_output(
                    controller.pid,
                    error,
                    speed,
                    s[at.PID_INTEGRAL],
                    at.SAMPLE_S,
                    read / v.half_stroke,
                )
            s[at.READ] = read
            control_sample(s, v, m, g, command, stuck)
            if controller.kind == TRAJECTORY_SET:
                follow(o, controller.known, m, s)
                s[at.FAILED] = max(s[at.FAILED], o[at.FAILED])
            for j in range(2):
                s[at.LOG_VOLTS_A + j] += s[at.VOLTS_A + j] / samples
                s[at.LOG_A + j] += s[at.MEAN_A + j] / samples


@njit(cache=True)
def drive_open_loop(
    s: FloatArray, v: Valve, m: Curves, g: CurrentGains, command: FloatArray, out: FloatArray
) -> None:
    """Run N control samples under given inputs and show every state, for studies.

    Parameters
    ----------
    s : (STATE_SIZE,) array
        See `STATE_SIZE`; written in place.
    v, m, g : Valve, Curves, CurrentGains
        The valve and its current controllers.
    command : (N,) array
        Output of a position controller, -1..1 [1].
    out : (N, STATE_SIZE) array
        Overwritten with the states after each sample, see `STATE_SIZE`.
    """
    for n in range(len(command)):
        control_sample(s, v, m, g, command[n], False)
        out[n] = s


assert SUB_STEPS % MODEL_STEPS == 0
