# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The simulated valve: plant, production cycles, aging, faults and measurement."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.simulation.aging_laws import AgingRule
from valve_twin.core.simulation.block import SimulationBlock
from valve_twin.core.simulation.config import SimulationConfig, changed_plant, check_parameter
from valve_twin.core.simulation.faults import COMMON_KINDS, PLANT_KINDS, Faults
from valve_twin.core.simulation.measurement import RANDOM_PHASE, measure, start_sensor
from valve_twin.core.simulation.plant import Drive, Plant
from valve_twin.core.types import join_blocks

if TYPE_CHECKING:
    from collections.abc import Iterator

    from valve_twin.core.types import BoolArray, FloatArray

NS = 1_000_000_000
_LONGEST_S = 1e9  # a fault that lasts longer lasts until it is cleared [s]


class _Stream(IntEnum):
    """Independent random streams of one seed."""

    SENSOR = 1
    PROCESS = 2
    LOSS = 3
    CYCLE = 4
    FREEZE = 5
    COMMAND = 6


class SimulatedValve:
    """A valve in the computer: the same seed gives the same samples however they are asked for.

    Parameters
    ----------
    config : SimulationConfig
        Everything but the random numbers.
    seed : int
        Seed of all random streams, not negative.
    """

    def __init__(self, config: SimulationConfig, seed: int = 0) -> None:
        self.config = config
        self.period_ns = round(config.period_s * NS)
        self._seed = seed
        self._sample = 0
        self._cycle = config.first_cycle
        self._rules = {rule.parameter: rule for rule in config.aging}
        self._faults = Faults()
        self._since_start = 0
        self._fault_start = round(config.fault.start_s / config.period_s)
        self._plant, self._phase = self._draw_cycle(self._cycle)
        self._state = config.plant.initial_state()
        self._sensor = start_sensor(config.measurement, float(self._state[0]))
        self._ticks = config.plant.ticks_per_sample(config.period_s)
        self._program = config.program.reference(config.period_s / self._ticks)
        self._sensor_noise = np.random.default_rng([seed, _Stream.SENSOR])
        self._process_noise = np.random.default_rng([seed, _Stream.PROCESS])
        self._losses = np.random.default_rng([seed, _Stream.LOSS])
        self._freezes = np.random.default_rng([seed, _Stream.FREEZE])
        self._lost_commands = np.random.default_rng([seed, _Stream.COMMAND])
        self._armed = True
        self._was_active = False
        self._moved = False

    @property
    def time_ns(self) -> int:
        """Return the simulated time of the next sample [ns]."""
        return self._sample * self.period_ns

    @property
    def cycle(self) -> int:
        """Return the number of the running cycle."""
        return self._cycle

    @property
    def plant(self) -> Plant:
        """Return the plant of the running cycle, aged and scattered."""
        return self._plant

    @property
    def failure(self) -> str:
        """Return when and in what state the plant's integration failed, empty if it did not."""
        return self._plant.failure(self._state)

    def advance(self, samples: int, commands: FloatArray | None = None) -> SimulationBlock:
        """Simulate the next samples.

        Parameters
        ----------
        samples : int
            How many (N), not negative.
        commands : (N, M) array, optional
            Commands, each held for one sample [1]; needed with controller "external" only. Values
            are limited to `command_range`.

        Raises
        ------
        ValueError
            If commands are missing, superfluous, not finite or of the wrong shape.
        """
        given = self._checked(samples, commands)
        starts = self._starts(samples, given)
        parts = [self._run(0, None if given is None else given[:0])]
        done = 0
        while done < samples:
            if starts[done]:
                self._start_cycle()
            self._begin_start_fault()
            self._faults = self._faults.at(self._sample)
            count = self._count_until_change(starts[done:])
            parts.append(self._run(count, None if given is None else given[done : done + count]))
            done += count
        return join_blocks(parts[1:] or parts)

    def set_fault(self, kind: str, severity: float = 0.0, duration_s: float = 0.0) -> str:
        """Start a fault now, or clear all with kind "none"; return what was done in one line.

        Parameters
        ----------
        kind : str
            leak, stuck, sensor_freeze, lost_samples, what else the plant takes, or none.
        severity : float
            As in `Fault`.
        duration_s : float
            Simulated time it stays [s], 0 = until cleared.

        Raises
        ------
        ValueError
            If the kind is unknown or a value outside its range.
        """
        if not 0.0 <= duration_s <= _LONGEST_S:
            message = f"fault.duration = {duration_s!r}: must be a time from 0 to 1e9 [s]"
            raise ValueError(message)
        count = max(round(duration_s / self.config.period_s), 1) if duration_s > 0.0 else 0
        taken = (*COMMON_KINDS, *self.config.plant.fault_kinds)
        faults = self._faults.with_fault(kind, severity, self._sample, count)
        if kind not in ("none", *taken):
            message = f"fault.kind = {kind!r}: this valve takes {', '.join(taken)} or none"
            raise ValueError(message)
        self._faults = faults
        if kind == "none":
            return "all faults cleared"
        until = f"for {duration_s:g} s" if count else "until cleared"
        return f"{kind} (severity {severity:g}) from {self.time_ns / NS:.2f} s {until}"

    def set_aging(self, parameter: str, law: str, rate: float, start_cycle: int = 0) -> str:
        """Let a plant parameter age; it takes effect at the next start of a cycle.

        Parameters
        ----------
        parameter : str
            Name of a plant parameter, e.g. "area_in".
        law : str
            none, linear, exponential or step.
        rate : float
            Relative change a cycle, for "step" once [1].
        start_cycle : int
            First cycle that ages, 0 = the next one.

        Raises
        ------
        ValueError
            If the parameter or the law is unknown or the rate outside its range.
        """
        check_parameter(self.config.plant, parameter)
        first = start_cycle if start_cycle > 0 else self._cycle + 1
        self._rules[parameter] = AgingRule(parameter, law, float(rate), first)
        if law == "none":
            return f"{parameter} does not age"
        return f"{parameter} ages by law {law}, rate {rate:g}, from cycle {first}"

    def aged_plant(self, cycle: int) -> Plant:
        """Return the plant of a cycle, aged but not scattered."""
        factors = {rule.parameter: rule.factor(cycle) for rule in self._rules.values()}
        return changed_plant(self.config.plant, factors)

    def steady_gain(self, cycle: int, command: float, *, input_index: int = 0) -> float:
        """Return the true steady gain of the aged plant: displacement a sample over command [1].

        Parameters
        ----------
        cycle : int
            Cycle number.
        command : float
            Constant command [1], above 0.
        input_index : int
            Which command acts alone, e.g. 0 = v_in, 1 = v_out.
        """
        inputs = np.zeros(len(self.config.plant.inputs))
        inputs[input_index] = command
        rate = self.aged_plant(cycle).steady_rate(inputs)
        return abs(rate) * self.config.period_s / command

    def _checked(self, samples: int, commands: FloatArray | None) -> FloatArray | None:
        """Return the commands as a (N, M) array inside their range, or refuse them."""
        external = self.config.controller == "external"
        if samples < 0:
            message = f"samples = {samples}: must not be negative"
            raise ValueError(message)
        if external != (commands is not None):
            needs = "needs" if external else "takes no"
            message = f"controller '{self.config.controller}' {needs} commands"
            raise ValueError(message)
        if commands is None:
            return None
        given = np.ascontiguousarray(commands, dtype=np.float64)
        shape = (samples, len(self.config.plant.inputs))
        if given.shape != shape or not np.isfinite(given).all():
            message = f"commands: must be finite and of shape {shape}, got shape {given.shape}"
            raise ValueError(message)
        return np.clip(given, *self.config.plant.command_range)

    def _starts(self, samples: int, commands: FloatArray | None) -> BoolArray:
        """Return at which of the next N samples a new cycle starts, (N,)."""
        if commands is None:
            index = self._sample + np.arange(samples)
            at_start: BoolArray = (index > 0) & (index % self.config.cycle_samples == 0)
            return at_start
        config = self.config
        active = commands[:, config.start_command] > config.threshold
        rearm = np.ones(samples, dtype=np.bool_)
        if config.rearm_command >= 0:
            rearm = commands[:, config.rearm_command] > config.threshold
        starts = np.zeros(samples, dtype=np.bool_)
        for n in range(samples):
            self._armed = self._armed or bool(rearm[n])
            if active[n] and not self._was_active and self._armed:
                starts[n] = self._moved
                self._moved = True
                self._armed = False
            self._was_active = bool(active[n])
        return starts

    def _begin_start_fault(self) -> None:
        """Start the configured fault at its time."""
        fault = self.config.fault
        if fault.kind != "none" and self._sample == self._fault_start:
            self.set_fault(fault.kind, fault.severity, fault.duration_s)

    def _count_until_change(self, starts: BoolArray) -> int:
        """Return for how many of the samples ahead cycle and faults stay as they are."""
        later = np.flatnonzero(starts[1:])
        count = int(later[0]) + 1 if len(later) else len(starts)
        changes = (self._faults.next_change(self._sample), self._fault_start)
        return min(count, *(c - self._sample if c > self._sample else count for c in changes))

    def _start_cycle(self) -> None:
        """Go to the next cycle: age, scatter and draw the phase of the refresh."""
        self._cycle += 1
        self._since_start = 0
        self._plant, self._phase = self._draw_cycle(self._cycle)

    def _draw_cycle(self, cycle: int) -> tuple[Plant, int]:
        """Return the plant and the refresh phase of a cycle: the same whenever it is asked for."""
        random = np.random.default_rng([self._seed, _Stream.CYCLE, cycle])
        layer = self.config.measurement
        phase = int(random.integers(layer.refresh))
        if layer.refresh_phase != RANDOM_PHASE:
            phase = layer.refresh_phase
        factors = {rule.parameter: rule.factor(cycle) for rule in self._rules.values()}
        for scatter in self.config.scatter:
            change = 1.0 + scatter.sigma * float(random.standard_normal())
            factors[scatter.parameter] = factors.get(scatter.parameter, 1.0) * change
        return changed_plant(self.config.plant, factors), phase

    def _run(self, count: int, commands: FloatArray | None) -> SimulationBlock:
        """Simulate samples of one cycle under the same faults."""
        first = self._since_start * self._ticks
        ticks = np.arange(first, first + count * self._ticks) % len(self._program.position)
        reference = self._program.position[ticks]
        layer = self.config.measurement
        frozen, freezes = self._draw_freezes(count)
        plant = self._plant
        for fault in self._faults.of(PLANT_KINDS):
            plant = plant.with_fault(fault.kind, fault.severity)
        gain = 1.0 + self._faults.severity("sensor_gain")
        offset = self._faults.severity("sensor_offset")
        drive = Drive(
            reference=reference,
            hold=self._program.hold[ticks],
            commands=commands,
            disturbance=layer.process_noise * self._process_noise.standard_normal(count),
            leak_rate=self._faults.severity("leak"),
            stuck=self._faults.has("stuck"),
            frozen=frozen,
            sensor_gain=gain,
            sensor_offset=offset,
            freezes=freezes,
            lost_commands=self._draw_lost_commands(count),
            seed=self._seed,
        )
        response = plant.run(self._state, drive, self.config.period_s)
        noise = self._sensor_noise.standard_normal(count)
        phase = (self._phase - self._since_start) % layer.refresh
        self._sensor, measured = measure(
            self._sensor,
            layer,
            response.position,
            noise,
            phase,
            frozen=frozen if freezes is None else freezes,
            gain=gain,
            offset=offset,
        )
        lost = self._losses.random(count) < self._faults.severity("lost_samples")
        stamp_ns = (self._sample + np.arange(count, dtype=np.int64)) * self.period_ns
        self._sample += count
        self._since_start += count
        return SimulationBlock(
            stamp_ns=stamp_ns,
            cycle=np.full(count, self._cycle, dtype=np.int64),
            reference=np.full(count, np.nan)
            if commands is not None
            else reference[:: self._ticks],
            inputs=response.inputs + np.array(layer.command_offsets or 0.0),
            position=measured,
            true_position=response.position,
            delivered=~lost,
        )

    def _draw_freezes(self, count: int) -> tuple[bool, BoolArray | None]:
        """Return whether the sensor freezes for good, else at which samples."""
        share = self._faults.severity("sensor_freeze")
        if not self._faults.has("sensor_freeze") or not 0.0 < share < 1.0:
            return self._faults.has("sensor_freeze"), None
        return False, self._freezes.random(count) < share

    def _draw_lost_commands(self, count: int) -> BoolArray | None:
        """Return the samples whose command is lost, None where the fault is absent."""
        if not self._faults.has("command_loss"):
            return None
        lost: BoolArray = self._lost_commands.random(count) < self._faults.severity("command_loss")
        return lost


def simulate_cycles(
    config: SimulationConfig, cycles: int, seed: int = 0
) -> Iterator[SimulationBlock]:
    """Yield production cycles one by one, a block each.

    Parameters
    ----------
    config : SimulationConfig
        Plant, program, measurement, aging.
    cycles : int
        How many [1].
    seed : int
        Of all random numbers.
    """
    valve = SimulatedValve(config, seed)
    for _ in range(cycles):
        yield valve.advance(config.cycle_samples)
