# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Records of the DAMADICS actuator: process inputs, faults, sensors with their noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, pi
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.damadics.motion import (
    COLUMNS,
    OUT_AIR,
    OUT_DRIVE,
    OUT_P1,
    OUT_P2,
    OUT_SUPPLY,
    OUT_T,
    SENSED,
    STEP_S,
    TRUE_FLOW,
    TRUE_ROD,
    Line,
    rest,
    run,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import FloatArray

PRESSURE_SPAN, WARMTH_SPAN, FLOW_SPAN, AIR_SPAN = 4e6, 200.0, 40.0, 1e6
"""Spans of the sensors [Pa], [C], [t/h], [Pa]."""
WHITE, HUM, HUM_HZ = np.sqrt(2e-6), 0.0025, 50.0
"""Noise of a sensor: standard deviation of its white part, amplitude [1] and frequency [Hz]."""
EVERY = 400
"""Steps of the integration in a sample."""

_BLOCK = 600  # samples simulated at once


@dataclass(frozen=True, slots=True)
class Wave:
    """An input of the process: mean + amplitude sin(2 pi frequency t + phase), and one step.

    Attributes
    ----------
    mean, amplitude : float
        [unit of the input].
    frequency : float
        [Hz].
    phase : float
        [rad].
    step_s, step : float
        When it steps [s], and by how much [unit of the input].
    """

    mean: float
    amplitude: float = 0.0
    frequency: float = 0.0
    phase: float = 0.0
    step_s: float = inf
    step: float = 0.0

    def at(self, time_s: FloatArray) -> FloatArray:
        """Return its (n,) values at (n,) times [s]."""
        values = np.full(len(time_s), self.mean)
        if self.amplitude:
            values += self.amplitude * np.sin(2.0 * pi * self.frequency * time_s + self.phase)
        values[time_s >= self.step_s] += self.step
        return values


@dataclass(frozen=True, slots=True)
class Process:
    """What the process does to the valve; the defaults are the benchmark's data generator.

    Attributes
    ----------
    command : Wave
        Commanded position CV, 0 = open .. 1 = closed [1].
    p1, p2 : Wave
        Pressures before and behind the valve [Pa].
    temperature : float
        Of the water [C].
    """

    command: Wave = Wave(0.5, 0.25, 0.01)
    p1: Wave = Wave(3.5e6, 1.75e5, 0.1)
    p2: Wave = Wave(2.6e6, 2.6e4, 1.0 / pi)
    temperature: float = 43.0

    def detuned(self) -> Process:
        """Return the process with pressures whose phase against the command wanders.

        In the benchmark's generator ten waves of the first pressure are one of the command: a
        model learnt there knows one phase only.
        """
        p1 = replace(self.p1, frequency=1.003 * self.p1.frequency)
        p2 = replace(self.p2, frequency=1.0007 * self.p2.frequency)
        return replace(self, p1=p1, p2=p2)

    def with_phases(self, rng: np.random.Generator) -> Process:
        """Return the same process begun at other, random phases."""
        command, p1, p2 = (
            replace(wave, phase=rng.uniform(0.0, 2.0 * pi))
            for wave in (self.command, self.p1, self.p2)
        )
        return replace(self, command=command, p1=p1, p2=p2)


@dataclass(frozen=True, slots=True)
class Fault:
    """One of the 19 faults and its course.

    Attributes
    ----------
    number : int
        1 .. 19.
    strength : float
        Greatest strength with its direction, -1 .. 1 [1].
    start_s, rise_s, end_s : float
        When it starts, how long it grows, 0 = a jump, and when it ends [s].
    """

    number: int
    strength: float
    start_s: float
    rise_s: float = 0.0
    end_s: float = inf

    def at(self, time_s: FloatArray) -> FloatArray:
        """Return its (N,) strength without its direction at (N,) times [s]."""
        since = time_s - self.start_s
        grown = np.clip(since / self.rise_s, 0.0, 1.0) if self.rise_s else np.ones(len(time_s))
        return np.where((since > 0.0) & (time_s < self.end_s), abs(self.strength) * grown, 0.0)


@dataclass(frozen=True, slots=True)
class Record:
    """What is seen of the actuator, a sample a second.

    Attributes
    ----------
    signals : (N, 6) array
        The official signals CV, P1, P2, T1, X and F, each a part of its span [1].
    hidden : (N, 3) array
        Supply pressure, controller's output, chamber pressure, without noise [1]; not official.
    true : (N, 2) array
        Position of the rod [1] and flow [t/h]; not for a diagnosis.
    """

    signals: FloatArray
    hidden: FloatArray
    true: FloatArray

    @property
    def time_s(self) -> FloatArray:
        """The (N,) times [s]."""
        return np.arange(len(self.signals), dtype=np.float64)


def simulate(
    samples: int,
    faults: Sequence[Fault] = (),
    *,
    seed: int | None = 0,
    process: Process | None = None,
    consistent: bool = False,
    state: FloatArray | None = None,
) -> Record:
    """Simulate the actuator from rest.

    Parameters
    ----------
    samples : int
        How many seconds.
    faults : sequence of Fault
        At most one of a number.
    seed : int or None
        Of the noise of the sensors; None = without noise.
    process : Process, optional
        What acts on the valve; default the benchmark's data generator.
    consistent : bool
        Air chamber by its mass alone, not as in the library; see docs/damadics.md.
    state : (18,) array, optional
        State to start from, written in place [unit by element]; default rest.
    """
    drawn = process or Process()
    z = rest() if state is None else state
    rng = None if seed is None else np.random.default_rng([seed, 0])
    table = np.array([[f.number, f.strength, f.start_s, f.rise_s, f.end_s] for f in faults])
    table = table.reshape(-1, 5)
    rows = np.empty((samples, COLUMNS))
    command = np.empty(samples)
    for first in range(0, samples, _BLOCK):
        last = min(first + _BLOCK, samples)
        time_s = STEP_S * np.arange(first * EVERY, last * EVERY, dtype=np.float64)
        clean = drawn.command.at(time_s)
        command[first:last] = clean[::EVERY]
        if rng is not None:
            hum = HUM * np.sin(2.0 * pi * HUM_HZ * time_s)
            clean = clean + hum + WHITE * rng.standard_normal(len(time_s))
        line = Line(
            command=clean,
            p1=drawn.p1.at(time_s),
            p2=drawn.p2.at(time_s),
            temperature=drawn.temperature,
            faults=table,
            consistent=consistent,
            pushed=np.zeros(1),
        )
        run(z, line, EVERY, rows[first:last])
    return _measured(command, rows, faults, seed)


def _measured(
    command: FloatArray, rows: FloatArray, faults: Sequence[Fault], seed: int | None
) -> Record:
    """Return what the sensors make of the true values; at whole seconds their hum is zero."""
    time_s = np.arange(len(rows), dtype=np.float64)

    def scaled(column: int, span: float, number: int = 0) -> FloatArray:
        values = np.clip(rows[:, column] / span, 0.0, 1.0)
        for fault in faults:
            if fault.number == number:
                sign = np.sign(fault.strength)
                values = np.clip(values * (1.0 - sign * fault.at(time_s)), 0.0, 1.0)
        return values

    signals = np.column_stack(
        [
            command,
            scaled(OUT_P1, PRESSURE_SPAN),
            scaled(OUT_P2, PRESSURE_SPAN),
            scaled(OUT_T, WARMTH_SPAN),
            scaled(SENSED, 1.0),
            scaled(TRUE_FLOW, FLOW_SPAN, 19),
        ]
    )
    if seed is not None:
        noise = np.random.default_rng([seed, 1]).standard_normal((len(rows), 5))
        signals[:, 1:] = np.clip(signals[:, 1:] + WHITE * noise, 0.0, 1.0)
    hidden = np.column_stack(
        [
            scaled(OUT_SUPPLY, AIR_SPAN),
            0.5 * (rows[:, OUT_DRIVE] + 1.0),
            scaled(OUT_AIR, AIR_SPAN, 14),
        ]
    )
    return Record(signals, hidden, rows[:, [TRUE_ROD, TRUE_FLOW]].copy())
