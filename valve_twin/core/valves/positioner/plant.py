# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The simulated positioner: the recursion of `kernels`, stepped finer than it is sampled."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numba import njit

from valve_twin.core.physics.quantity import check_quantities, quantity
from valve_twin.core.simulation.config import SimulationConfig
from valve_twin.core.simulation.plant import Drive, PlantFactory, Response
from valve_twin.core.simulation.program import CycleProgram
from valve_twin.core.valves.positioner.kernels import advance

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

_MAX_DELAY_TICKS = 4096
_POSITION, _HEAD, _LINE = 0, 1, 2


@njit(cache=True)
def _run(
    state: FloatArray,
    p: FloatArray,
    tick_s: float,
    delay: int,
    ticks: int,
    commands: FloatArray,
    disturbance: FloatArray,
    leak_rate: float,
    stuck: bool,
    position: FloatArray,
) -> None:
    for n in range(len(position)):
        position[n] = state[_POSITION]
        for k in range(ticks):
            head = int(state[_HEAD])
            state[_LINE + head] = commands[n * ticks + k]
            state[_HEAD] = (head + 1) % _MAX_DELAY_TICKS
            command = state[_LINE + (head - delay) % _MAX_DELAY_TICKS]
            x = state[_POSITION]
            moved = advance(x, command, p, tick_s) - x
            if moved != 0.0:
                moved += disturbance[n] / ticks
            moved -= leak_rate * tick_s
            if not stuck:
                state[_POSITION] = min(max(x + moved, 0.0), 1.0)


@dataclass(frozen=True, slots=True)
class PositionerPlant:
    """Numbers of the simulated positioner; every field carries its unit, range and description."""

    inputs: ClassVar[tuple[str, ...]] = ("command",)

    rate_rising: float = quantity(
        4.0, "1/s", "Speed per distance, rising", lower=1e-4, upper=1e3, assumed=True
    )
    rate_falling: float = quantity(
        3.0, "1/s", "Speed per distance, falling", lower=1e-4, upper=1e3, assumed=True
    )
    slew_rising: float = quantity(
        0.6, "1/s", "Largest speed, rising", lower=1e-5, upper=1e3, assumed=True
    )
    slew_falling: float = quantity(
        0.4, "1/s", "Largest speed, falling", lower=1e-5, upper=1e3, assumed=True
    )
    dead_band: float = quantity(
        0.005, "1", "Distance that moves nothing", lower=0.0, upper=0.5, assumed=True
    )
    delay: float = quantity(
        0.05, "s", "Command to motion delay", lower=0.0, upper=10.0, assumed=True
    )
    step: float = quantity(
        0.01, "s", "Step of the recursion", lower=1e-4, upper=1.0, assumed=True, ages=False
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range, and a delay that the line cannot hold."""
        check_quantities(self)
        if self.delay / self.step >= _MAX_DELAY_TICKS:
            message = f"delay = {self.delay!r}: must be below {_MAX_DELAY_TICKS} x step [s]"
            raise ValueError(message)

    def ticks_per_sample(self, period_s: float) -> int:
        """Return how many steps a sample takes."""
        count = round(period_s / self.step)
        if count < 1 or abs(count * self.step - period_s) > 1e-9 * period_s:
            message = f"period_s = {period_s!r}: must be a multiple of step = {self.step!r} [s]"
            raise ValueError(message)
        return count

    def initial_state(self) -> FloatArray:
        """Return the state at rest: position, head and content of the delay line."""
        return np.zeros(_LINE + _MAX_DELAY_TICKS)

    def run(self, state: FloatArray, drive: Drive, period_s: float) -> Response:
        """Run N samples; `state` is written in place. The command is the reference itself."""
        ticks = self.ticks_per_sample(period_s)
        samples = len(drive.disturbance)
        commands = self._commands(drive, ticks)
        position = np.empty(samples)
        _run(
            state,
            self._parameters(),
            float(self.step),
            round(self.delay / self.step),
            ticks,
            commands,
            np.ascontiguousarray(drive.disturbance),
            float(drive.leak_rate),
            bool(drive.stuck),
            position,
        )
        return Response(position, np.ascontiguousarray(commands[::ticks].reshape(-1, 1)))

    def steady_rate(self, inputs: FloatArray) -> float:
        """Return the speed at mid-stroke under a constant command (1,) [1/s]."""
        e = float(inputs[0]) - 0.5
        beyond = max(abs(e) - self.dead_band, 0.0)
        if e > 0.0:
            return min(self.rate_rising * beyond, self.slew_rising)
        return -min(self.rate_falling * beyond, self.slew_falling)

    def _parameters(self) -> FloatArray:
        rates = (self.rate_rising, self.rate_falling, self.slew_rising, self.slew_falling)
        return np.array([*rates, self.dead_band])

    @staticmethod
    def _commands(drive: Drive, ticks: int) -> FloatArray:
        """Return the command of every step: it is sent once a sample and held."""
        sent = drive.reference[::ticks] if drive.commands is None else drive.commands[:, 0]
        return np.ascontiguousarray(np.repeat(sent, ticks))


class _PositionerPlant:
    """What makes the positioner simulable."""

    name = "positioner"

    def simulation(self) -> SimulationConfig:
        """Return a cycle of steps and ramps through most of the stroke, sampled every 50 ms."""
        program = CycleProgram(
            times_s=(0.0, 1.0, 6.0, 9.0, 14.0, 17.0, 22.0, 25.0),
            kinds=("hold", "step", "step", "ramp", "step", "step", "ramp", "step"),
            targets=(0.1, 0.8, 0.75, 0.3, 0.35, 0.9, 0.4, 0.1),
            duration_s=30.0,
        )
        return SimulationConfig(plant=PositionerPlant(), program=program, period_s=0.05)


PLANT: PlantFactory = _PositionerPlant()
