# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Run a stranger and record its command and position cycle by cycle."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.validation.any_strangers.draw import CYCLES, wanted
from valve_twin.validation.any_strangers.kernel import CYLINDER, STEP_S, run
from valve_twin.validation.any_strangers.troubles import troubled

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray, IntArray
    from valve_twin.validation.any_strangers.draw import Stranger
    from valve_twin.validation.any_strangers.kernel import Valve
    from valve_twin.validation.any_strangers.troubles import Trouble

START_NS = 1_700_000_000_000_000_000
"""Stamp of the beginning [ns]."""

_TAIL = round(5.0 / STEP_S)
"""Steps that are kept of the cycle before: more than any dead time."""

_RANGE = (-0.05, 1.05)
"""Of the position that the converter covers [1]."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """What was recorded of one production cycle.

    Attributes
    ----------
    cycle : int
        Its number, counted from 1.
    start_ns : int
        Stamp at which it begins [ns].
    stamp_ns, command, position : (N,) arrays
        Stamps [ns], command and position [1].
    """

    cycle: int
    start_ns: int
    stamp_ns: IntArray
    command: FloatArray
    position: FloatArray


class Machine:
    """A stranger at work; a copy goes on by itself.

    Parameters
    ----------
    stranger : Stranger
        Which.
    record : int
        Number of the record: its chances differ from those of others.
    """

    def __init__(self, stranger: Stranger, record: int = 0) -> None:
        self._stranger, self._record = stranger, record
        rest = 0.5 if stranger.valve.kind == CYLINDER else 0.0
        self._state = np.array([0.0, 0.0, 0.0, rest])
        self._sent, self._place = np.full(_TAIL, rest), np.zeros(_TAIL)
        self._steps, self._samples = 0, 0
        self._held = 0.0
        self.cycle = 0

    def __copy__(self) -> Machine:
        """Return a machine that goes on from here by itself."""
        other = Machine(self._stranger, self._record)
        other.__dict__.update(self.__dict__)
        other._state = self._state.copy()
        return other

    def next_cycle(self, trouble: Trouble | None = None) -> Recorded:
        """Run and record the next production cycle, under a trouble where there is one."""
        self.cycle += 1
        stranger = self._stranger
        rng = np.random.default_rng([11, stranger.seed, self._record, self.cycle])
        asked, move = wanted(stranger.programme, rng)
        share = trouble.severity if trouble and trouble.name == "command_loss" else 0.0
        moves = rng.random(int(move[-1]) + 1) < share
        lost = np.where(moves[move.astype(np.int64)], 1.0, 0.0)
        place, sent = run(
            self._state,
            troubled(self._worn(rng), trouble),
            asked,
            lost,
            self._sent,
            stranger.logger.tick,
        )
        begin = self._steps
        self._steps += len(asked)
        places = np.concatenate((self._place, place))
        commands = np.concatenate((self._sent, sent))
        self._place, self._sent = places[-_TAIL:], commands[-_TAIL:]
        return self._taken(begin, places, commands, trouble, rng)

    def _worn(self, rng: np.random.Generator) -> Valve:
        """Return the valve as it is in this cycle, without a trouble."""
        stranger = self._stranger
        pace = 1.0 + stranger.ages * self.cycle / CYCLES
        pace *= 1.0 + stranger.wanders * rng.standard_normal()
        valve = stranger.valve
        return valve._replace(up=valve.up * pace, down=valve.down * pace)

    def _taken(
        self,
        begin: int,
        places: FloatArray,
        commands: FloatArray,
        trouble: Trouble | None,
        rng: np.random.Generator,
    ) -> Recorded:
        """Sample what happened since a step."""
        logger = self._stranger.logger
        end_s = self._steps * STEP_S
        last = int(np.ceil((end_s - logger.phase_s) / logger.period_s))
        index = np.arange(self._samples, last)
        at_s = logger.phase_s + logger.period_s * index
        steps = np.floor(at_s / STEP_S).astype(np.int64) - begin + _TAIL
        late = round(logger.command_late_s / STEP_S)
        position = self._sensed(places[steps], trouble, rng)
        self._samples = last
        return Recorded(
            self.cycle,
            START_NS + round(begin * STEP_S * 1e9),
            START_NS + np.rint(at_s * 1e9).astype(np.int64),
            commands[steps - late],
            position,
        )

    def _sensed(
        self, place: FloatArray, trouble: Trouble | None, rng: np.random.Generator
    ) -> FloatArray:
        """Return what the sensor shows."""
        logger, (low, high) = self._stranger.logger, _RANGE
        name, size = (trouble.name, trouble.severity) if trouble else ("", 0.0)
        sigma = logger.noise * (size if name == "noise" else 1.0)
        x = place + sigma * rng.standard_normal(len(place))
        lsb = (high - low) * 2.0**-logger.bits
        x = low + lsb * np.round((np.clip(x, low, high) - low) / lsb)
        fresh = rng.random(len(x)) >= (size if name in {"repeats", "frozen"} else 0.0)
        newest = np.maximum.accumulate(np.where(fresh, np.arange(len(x)), -1))
        shown = np.where(newest >= 0, x[np.maximum(newest, 0)], self._held)
        self._held = float(shown[-1])
        return np.asarray(shown, dtype=np.float64)


def record(stranger: Stranger, cycles: int, *, number: int = 0) -> list[Recorded]:
    """Return the first cycles of a record without trouble.

    Parameters
    ----------
    stranger : Stranger
        Which.
    cycles : int
        How many [1].
    number : int
        Of the record: 0 is that which is watched.
    """
    machine = Machine(stranger, number)
    return [machine.next_cycle() for _ in range(cycles)]


def branch(machine: Machine) -> Machine:
    """Return a copy that goes on by itself."""
    return copy(machine)
