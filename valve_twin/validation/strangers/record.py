# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Run a stranger cycle by cycle: what its logger records, and the truth behind it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import lfilter

from valve_twin.validation.strangers.kernel import STEP_S, TRACE_S, Press, run_cycle, steady_speed
from valve_twin.validation.strangers.troubles import troubled

if TYPE_CHECKING:
    from collections.abc import Iterator

    from valve_twin.core.types import FloatArray, IntArray
    from valve_twin.validation.strangers.draw import Stranger

START_NS = 1_700_000_000_000_000_000
"""Stamp of the first sample [ns]."""

_TAIL_S = 0.2
_RANGE = (-0.06, 1.06)


@dataclass(frozen=True, slots=True)
class Recorded:
    """What was logged of one cycle.

    Attributes
    ----------
    cycle : int
        Its number, counted from 1.
    start_ns : int
        Stamp at which it begins [ns].
    stamp_ns, position : (N,) arrays
        Stamps [ns] and position [1].
    command_ns, commands : (M,), (M, 2) arrays
        Stamps [ns] and commands, inflow and outflow [1].
    present : Press
        The press as it was in this cycle.
    """

    cycle: int
    start_ns: int
    stamp_ns: IntArray
    position: FloatArray
    command_ns: IntArray
    commands: FloatArray
    present: Press


def aged(stranger: Stranger, cycle: float, recipe: int = 0) -> Press:
    """Return the press in a cycle by its aging alone, without faults and scatter.

    Parameters
    ----------
    stranger : Stranger
        Which.
    cycle : float
        Cycle, counted from 1 [1].
    recipe : int
        Product it makes [1].
    """
    p, aging = stranger.press, stranger.aging
    grown = max(1.0 + aging.share(cycle), 0.01)
    changed = {aging.part: getattr(p, aging.part) * grown}
    return p._replace(load=stranger.recipes[recipe].load, **changed)


def gain(press: Press, command: float, period_s: float, *, outflow: bool = False) -> float:
    """Return the true steady gain at a command: stroke a sample per unit command, leak apart.

    The command is the logged one: what coil, preload and an offset take from it is part of the
    gain, as it is for whoever commands the press.

    Parameters
    ----------
    press : Press
        The press as it is.
    command : float
        Command at which the gain is asked for [1].
    period_s : float
        Sampling time [s].
    outflow : bool
        Of the emptying pilots, not of the filling ones.
    """
    v_in = max(command * press.coil + press.command_offset - press.preload, 0.0)
    v = (0.0, max(command + press.command_offset, 0.0)) if outflow else (v_in, 0.0)
    moved = steady_speed(press, *v) - steady_speed(press, 0.0, 0.0)
    return abs(moved) * period_s / command


def leak(press: Press) -> float:
    """Return the true loss of stroke off the seat [1/s]."""
    return -steady_speed(press, 0.0, 0.0)


def record(stranger: Stranger) -> Iterator[Recorded]:
    """Run a stranger and yield what is logged of each cycle, in order."""
    rng = np.random.default_rng([7, stranger.seed])
    logger, plc = stranger.logger, stranger.plc
    tick_s = plc.ticks * STEP_S
    state = np.array([0.0, 0.0, 0.9 * stranger.press.supply, 0.0, 0.0])
    memory = np.zeros(6)
    taps = _Taps(stranger)
    wander = 0.0
    for k in range(stranger.cycles):
        number = k + 1
        active = tuple(t for t in stranger.troubles if t.at(number))
        names = {t.name: t.severity for t in active}
        press = troubled(aged(stranger, number, stranger.recipe_of[k]), active)
        scatter = stranger.supply_scatter * rng.standard_normal()
        warm = stranger.warm_up * np.exp(-number / 8.0)
        press = press._replace(
            supply=press.supply * (1.0 + scatter), damping=press.damping * (1.0 + 10.0 * warm)
        )
        reference = stranger.recipes[stranger.recipe_of[k]].reference(tick_s)
        pause = np.zeros(round(stranger.pauses[k] / tick_s))
        reference = np.concatenate((reference, pause))
        noise = stranger.control_noise * rng.standard_normal(len(reference))
        noise[reference <= 0.0] = 0.0
        lost = (rng.random(len(reference)) < names.get("command_loss", 0.0)).astype(float)
        trace, commands = run_cycle(
            state, memory, press, plc, reference, noise, lost, "no_motion" in names
        )
        wander += logger.drift * rng.standard_normal() * 0.2
        yield taps.take(number, trace, commands, names, wander, press, rng)


class _Taps:
    """Logger of a stranger: two clocks that go on through all cycles."""

    def __init__(self, stranger: Stranger) -> None:
        logger = stranger.logger
        self._logger = logger
        self._tick_s = stranger.plc.ticks * STEP_S
        self._begin = 0.0
        self._next_x = logger.phase_s
        self._next_v = logger.phase_s
        self._count_x = self._count_v = 0
        self._tail = np.zeros(round(_TAIL_S / TRACE_S))
        self._tail_v = np.zeros((round(_TAIL_S / self._tick_s), 2))
        self._filtered = np.zeros(1)
        self._held = 0.0

    def take(
        self,
        number: int,
        trace: FloatArray,
        commands: FloatArray,
        faults: dict[str, float],
        wander: float,
        press: Press,
        rng: np.random.Generator,
    ) -> Recorded:
        """Log one cycle."""
        logger = self._logger
        end = self._begin + len(commands) * self._tick_s
        step_x = logger.period_s * (1.0 + logger.clock)
        step_v = step_x * (1.0 + logger.clocks_apart)
        n = max(int(np.ceil((end - self._next_x) / step_x)), 0)
        m = max(int(np.ceil((end - self._next_v) / step_v)), 0)
        at_x = self._next_x + step_x * np.arange(n, dtype=np.float64)
        at_v = self._next_v + step_v * np.arange(m)
        x: FloatArray = np.concatenate((self._tail, self._low_pass(trace)))
        position = self._position(x, at_x, faults, wander, rng)
        v = np.concatenate((self._tail_v, commands))
        back = at_v - logger.command_delay_s - self._begin
        index = np.floor(back / self._tick_s).astype(np.int64) + len(self._tail_v)
        seen = v[np.clip(index, 0, len(v) - 1)]
        nominal = round(logger.period_s * 1e9)
        stamps = START_NS + nominal * (self._count_x + np.arange(n, dtype=np.int64))
        stamps_v = START_NS + nominal * (self._count_v + np.arange(m, dtype=np.int64))
        self._next_x += step_x * n
        self._next_v += step_v * m
        self._count_x += n
        self._count_v += m
        self._tail = x[-len(self._tail) :]
        self._tail_v = v[-len(self._tail_v) :]
        self._begin = end
        return Recorded(number, int(stamps[0]), stamps, position, stamps_v, seen, press)

    def _position(
        self,
        trace: FloatArray,
        at: FloatArray,
        faults: dict[str, float],
        wander: float,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Return what the sensor shows at the times `at` [s]."""
        logger = self._logger
        grid = self._begin + TRACE_S * (np.arange(len(trace)) - len(self._tail))
        x = np.interp(at - logger.delay_s, grid, trace)
        x = x * (1.0 + faults.get("sensor_gain", 0.0)) + faults.get("sensor_offset", 0.0) + wander
        sigma = logger.noise * faults.get("sensor_noise", 1.0)
        x += sigma * rng.standard_normal(len(x))
        out = rng.random(len(x)) < logger.outliers
        x[out] += rng.uniform(-0.08, 0.08, int(np.count_nonzero(out)))
        low, high = _RANGE
        lsb = (high - low) * 2.0**-logger.bits
        x = low + lsb * np.round((np.clip(x, low, high) - low) / lsb)
        index = np.arange(len(x)) + self._count_x
        keep = index % logger.refresh == 0
        if "frozen" in faults:
            keep[:] = False
        elif faults.get("sensor_freeze", 0.0) > 0.0:
            keep &= rng.random(len(x)) >= faults["sensor_freeze"]
        last = np.maximum.accumulate(np.where(keep, np.arange(len(x)), -1))
        shown: FloatArray = np.where(last >= 0, x[np.maximum(last, 0)], self._held)
        if len(shown):
            self._held = float(shown[-1])
        return shown

    def _low_pass(self, trace: FloatArray) -> FloatArray:
        """Return the position behind the anti-aliasing filter."""
        tau = self._logger.filter_s
        if tau <= 0.0:
            return trace
        share = 1.0 - np.exp(-TRACE_S / tau)
        out, end = lfilter([share], [1.0, share - 1.0], trace, zi=self._filtered)
        self._filtered = end
        filtered: FloatArray = out
        return filtered
