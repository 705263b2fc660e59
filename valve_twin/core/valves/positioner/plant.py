# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The simulated positioner: the recursions of `kernels` or `extended`, in finer steps."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from valve_twin.core.quantity import assumed, check_quantities
from valve_twin.core.simulation.config import SimulationConfig
from valve_twin.core.simulation.plant import Drive, Forcing, Plant, Response, whole_ratio
from valve_twin.core.simulation.program import CycleProgram
from valve_twin.core.valves.positioner.extended import (
    BACKLASH,
    MOTION_SIZE,
    N_TRANSITION,
    delayed,
    move,
    target_of,
    transition,
)
from valve_twin.core.valves.positioner.kernels import advance
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.types import FloatArray

_MAX_DELAY_TICKS = 4096
_POSITION, _HEAD, _LINE = 0, 1, 2
_MOTION = _LINE + _MAX_DELAY_TICKS
_X, _Y = 0, MOTION_SIZE - 1


class _Clock(NamedTuple):
    """Length of a step [s], steps in a sample, delay of a rise and of a fall in steps."""

    tick_s: float
    ticks: int
    rising: int
    falling: int


@njit(cache=True)
def _run(
    state: FloatArray,
    p: FloatArray,
    clock: _Clock,
    forcing: Forcing,
    out: Response,
) -> None:
    reference, _, external, commands, disturbance, leak_rate, stuck, _, _, _ = forcing
    tick_s, ticks, delay, _ = clock
    position, inputs = out
    for n in range(len(position)):
        sent = commands[n, 0] if external else reference[n * ticks]
        position[n] = state[_POSITION]
        inputs[n, 0] = sent
        for _ in range(ticks):
            head = int(state[_HEAD])
            state[_LINE + head] = sent
            state[_HEAD] = (head + 1) % _MAX_DELAY_TICKS
            command = state[_LINE + (head - delay) % _MAX_DELAY_TICKS]
            x = state[_POSITION]
            moved = advance(x, command, p, tick_s) - x
            if moved != 0.0:
                moved += disturbance[n] / ticks
            moved -= leak_rate * tick_s
            if not stuck:
                state[_POSITION] = min(max(x + moved, 0.0), 1.0)


@njit(cache=True)
def _run_extended(
    state: FloatArray,
    p: FloatArray,
    clock: _Clock,
    forcing: Forcing,
    out: Response,
) -> None:
    z = state[_MOTION : _MOTION + MOTION_SIZE]
    line = state[_LINE : _LINE + _MAX_DELAY_TICKS]
    m = np.zeros(N_TRANSITION)
    reference, _, external, commands, disturbance, leak_rate, stuck, _, _, _ = forcing
    tick_s, ticks, rising, falling = clock
    position, inputs = out
    transition(p, tick_s, m)
    play = 0.5 * p[BACKLASH]
    for n in range(len(position)):
        sent = commands[n, 0] if external else reference[n * ticks]
        position[n] = z[_Y]
        inputs[n, 0] = sent
        for _ in range(ticks):
            head = int(state[_HEAD])
            line[head] = sent
            state[_HEAD] = (head + 1) % _MAX_DELAY_TICKS
            if stuck:
                continue
            x = z[_X]
            command = delayed(line, head + _MAX_DELAY_TICKS, rising, falling)
            move(z, target_of(command, p), p, tick_s, 1, m, 0.0, 1.0)
            if z[_X] != x:
                z[_X] += disturbance[n] / ticks
            z[_X] = min(max(z[_X] - leak_rate * tick_s, 0.0), 1.0)
            z[_Y] = min(max(z[_Y], z[_X] - play), z[_X] + play)
    state[_POSITION] = z[_Y]


@dataclass(frozen=True, slots=True)
class PositionerPlant(Plant):
    """Numbers of the simulated positioner; every field carries its unit, range and description."""

    inputs: ClassVar[tuple[str, ...]] = ("command",)

    rate_rising: float = assumed(4.0, "1/s", "Speed per distance, rising", 1e-4, 1e3)
    rate_falling: float = assumed(3.0, "1/s", "Speed per distance, falling", 1e-4, 1e3)
    slew_rising: float = assumed(0.6, "1/s", "Largest speed, rising", 1e-5, 1e3)
    slew_falling: float = assumed(0.4, "1/s", "Largest speed, falling", 1e-5, 1e3)
    dead_band: float = assumed(0.005, "1", "Distance that moves nothing", 0.0, 0.5)
    delay: float = assumed(0.05, "s", "Command to motion delay", 0.0, 10.0)
    delay_change: float = assumed(
        0.0, "s", "Delay of a falling command beyond that of a rising one", -10.0, 10.0
    )
    velocity_lag: float = assumed(0.0, "s", "Lag of the speed, 0 = none", 0.0, 10.0)
    stiction: float = assumed(0.0, "1", "Distance beyond the dead band to break away", 0.0, 0.5)
    backlash: float = assumed(0.0, "1", "Play between spool and position", 0.0, 0.5)
    dead_command: float = assumed(0.0, "1", "Command that moves nothing", 0.0, 0.9)
    static_gain: float = assumed(1.0, "1", "Position per command beyond that", 1e-3, 1e3)
    step: float = assumed(0.01, "s", "Step of the recursion", 1e-4, 1.0, ages=False)

    def __post_init__(self) -> None:
        """Refuse values outside their range, and a delay that the line cannot hold."""
        check_quantities(self)
        if self.delay / self.step >= _MAX_DELAY_TICKS:
            message = f"delay = {self.delay!r}: must be below {_MAX_DELAY_TICKS} x step [s]"
            raise ValueError(message)
        if not 0.0 <= self.delay + self.delay_change < _MAX_DELAY_TICKS * self.step:
            message = (
                f"delay_change = {self.delay_change!r}: with delay it must be from 0 to below "
                f"{_MAX_DELAY_TICKS} x step [s]"
            )
            raise ValueError(message)

    def ticks_per_sample(self, period_s: float) -> int:
        """Return how many steps a sample takes."""
        return whole_ratio(period_s, self.step, "period_s", "step")

    def initial_state(self) -> FloatArray:
        """Return the state at rest: position, head and content of the delay line."""
        return np.zeros(_MOTION + MOTION_SIZE)

    def run(self, state: FloatArray, drive: Drive, period_s: float) -> Response:
        """Run N samples, parameters as `Plant.run`. The command is the reference itself."""
        clock = _Clock(
            tick_s=float(self.step),
            ticks=self.ticks_per_sample(period_s),
            rising=round(self.delay / self.step),
            falling=round((self.delay + self.delay_change) / self.step),
        )
        forcing, out = drive.forcing(1), Response.empty(len(drive.disturbance), 1)
        if self._extended:
            _run_extended(state, self._all_parameters(), clock, forcing, out)
        else:
            _run(state, self._parameters(), clock, forcing, out)
        return out

    def steady_rate(self, inputs: FloatArray) -> float:
        """Return the speed at mid-stroke under a constant command (1,) [1/s]."""
        e = float(target_of(float(inputs[0]), self._all_parameters())) - 0.5
        beyond = max(abs(e) - self.dead_band, 0.0)
        if e > 0.0:
            return min(self.rate_rising * beyond, self.slew_rising)
        return -min(self.rate_falling * beyond, self.slew_falling)

    def _parameters(self) -> FloatArray:
        rates = (self.rate_rising, self.rate_falling, self.slew_rising, self.slew_falling)
        return np.array([*rates, self.dead_band])

    @property
    def _extended(self) -> bool:
        """Whether a term beyond the plain law is in force."""
        added = (self.delay_change, self.velocity_lag, self.stiction, self.backlash)
        return any(added) or self.dead_command != 0.0 or self.static_gain != 1.0

    def _all_parameters(self) -> FloatArray:
        """Return the 12 parameters of the extended law."""
        friction = (self.velocity_lag, self.stiction, self.backlash)
        curved = float(self.dead_command != 0.0 or self.static_gain != 1.0)
        curve = (self.dead_command, self.static_gain, 0.0, curved)
        return np.array([*self._parameters(), *friction, *curve])


STRANGERS: Mapping[str, Mapping[str, object]] = MappingProxyType(
    {
        "speed lags by 0.02 s": {"plant.velocity_lag": 0.02},
        "speed lags by 0.1 s": {"plant.velocity_lag": 0.1},
        "speed lags by 0.4 s": {"plant.velocity_lag": 0.4},
        "sticks by 0.003": {"plant.stiction": 0.003},
        "sticks by 0.01": {"plant.stiction": 0.01},
        "sticks by 0.03": {"plant.stiction": 0.03},
        "backlash 0.003": {"plant.backlash": 0.003},
        "backlash 0.01": {"plant.backlash": 0.01},
        "backlash 0.03": {"plant.backlash": 0.03},
        "dead command 0.01": {"plant.dead_command": 0.01},
        "dead command 0.05": {"plant.dead_command": 0.05},
        "settles 1 % lower": {"plant.static_gain": 0.99},
        "settles 5 % lower": {"plant.static_gain": 0.95},
        "settles 5 % higher": {"plant.static_gain": 1.05},
        "falls 0.05 s later": {"plant.delay_change": 0.05},
        "falls 0.2 s later": {"plant.delay_change": 0.2},
        "half a sample late": {"plant.delay": 0.07},
        "0.3 s late": {"plant.delay": 0.3},
        "half a sample late, not settling": {"plant.delay": 0.07, "plant.static_gain": 0.97},
        "noise 5e-3": {"measurement.noise": 5e-3},
        "noise 1e-5": {"measurement.noise": 1e-5},
        "quantised to 0.01": {"measurement.quantum": 0.01},
        "a new value every 3 samples": {"measurement.refresh": 3},
        "position offset 0.003": {"measurement.position_offset": 0.003},
        "position offset 0.02": {"measurement.position_offset": 0.02},
        "command logged 0.01 higher": {"measurement.command_offsets": (0.01,)},
        "process moves it by 1e-3": {"measurement.process_noise": 1e-3},
    }
)
"""Valves that are not as the options say, by how they differ."""


def default_simulation() -> SimulationConfig:
    """Return a cycle of steps and ramps through most of the stroke, sampled every 50 ms."""
    program = CycleProgram(
        times_s=(0.0, 1.0, 6.0, 9.0, 14.0, 17.0, 22.0, 25.0),
        kinds=("hold", "step", "step", "ramp", "step", "step", "ramp", "step"),
        targets=(0.1, 0.8, 0.75, 0.3, 0.35, 0.9, 0.4, 0.1),
        duration_s=30.0,
    )
    return SimulationConfig(plant=PositionerPlant(), program=program, period_s=0.05)
