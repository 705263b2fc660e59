# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Find a wave that repeats over the history, so that it is taken neither for changes nor for wear.

A valve whose commands change between two log samples ages through them: the edge that the logger
sees moves by a whole sample every so many cycles, and the estimates follow in teeth. A wave is
one tooth or one sine a period. The period may change along the history, and every edge of a tooth
may lie a few values off.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

FEWEST = 2.0
"""Periods that a history must hold for a wave to be seen in it [1]."""

_SHORTEST = 5.0  # values a period
_STEP = 0.25  # of the periods tried
_CHIRPS = (-0.4, -0.2, 0.0, 0.2, 0.4)
_BINS = 24  # of the phase
_ROUNDS = 6  # of the refinement, each halves its steps
_EDGE_ROUNDS = 6
_STEEPEST = 0.9  # chirp up to which the phase rises everywhere


@dataclass(frozen=True, slots=True)
class Wave:
    """A wave along u = 0 .. 1.

    Attributes
    ----------
    turns : (E,) array
        Where each period begins, rising; the outer ones may lie before 0 and after 1 [1].
    toothed : bool
        Teeth, else a sine.
    """

    turns: FloatArray
    toothed: bool

    @property
    def period(self) -> float:
        """Return the mean period [1]."""
        return float(self.turns[-1] - self.turns[0]) / (len(self.turns) - 1)

    def columns(self, u: FloatArray) -> FloatArray:
        """Return what a wave of unit size is at (N,) places, (N, 1) of teeth, (N, 2) of a sine."""
        turn = np.interp(u, self.turns, np.arange(len(self.turns)))
        if self.toothed:
            return np.asarray((turn - np.floor(turn) - 0.5)[:, None])
        angle = 2.0 * np.pi * turn
        return np.column_stack([np.cos(angle), np.sin(angle)])


def _wave(place: FloatArray, *, toothed: bool) -> Wave:
    """Return the wave of phase periods (u + chirp u (u - 1)) - phase, from before 0 to after 1."""
    periods, chirp, phase = place
    u = np.linspace(-2.0, 3.0, 2001)
    # the phase stays straight outside, where its parabola may turn back
    inside = np.clip(u, 0.0, 1.0)
    rate = np.where(u < 0.0, 1.0 - chirp, 1.0 + chirp)
    turn = periods * (inside + chirp * inside * (inside - 1.0) + rate * (u - inside)) - phase
    first = int(np.floor(np.interp(0.0, u, turn)))
    last = int(np.floor(np.interp(1.0, u, turn))) + 1
    return Wave(np.interp(np.arange(first, last + 1), turn, u), toothed)


@njit(cache=True)
def _search(u: FloatArray, rest: FloatArray, chirps: FloatArray, shortest: float) -> FloatArray:
    """Return gain, periods, chirp and phase of the best teeth and of the best sine, (2, 4)."""
    n = len(u)
    best = np.zeros((2, 4))
    sums, counts = np.empty(_BINS), np.empty(_BINS)
    for chirp in chirps:
        periods = FEWEST
        while periods <= n / shortest:
            sums[:] = 0.0
            counts[:] = 0.0
            for j in range(n):
                turn = periods * (u[j] + chirp * u[j] * (u[j] - 1.0))
                place = int((turn - np.floor(turn)) * _BINS) % _BINS
                sums[place] += rest[j]
                counts[place] += 1.0
            real, imaginary = 0.0, 0.0
            for b in range(_BINS):
                angle = 2.0 * np.pi * (b + 0.5) / _BINS
                real += sums[b] * np.cos(angle)
                imaginary += sums[b] * np.sin(angle)
            gain = 2.0 * (real * real + imaginary * imaginary) / n
            if gain > best[1, 0]:
                best[1] = np.array([gain, periods, chirp, 0.0])
            for shift in range(_BINS):
                product, square, total = 0.0, 0.0, 0.0
                for b in range(_BINS):
                    tooth = ((b - shift) % _BINS + 0.5) / _BINS - 0.5
                    product += sums[b] * tooth
                    square += counts[b] * tooth * tooth
                    total += counts[b] * tooth
                square -= total * total / n
                gain = product * product / square if square > 0.0 else 0.0
                if gain > best[0, 0]:
                    best[0] = np.array([gain, periods, chirp, shift / _BINS])
            periods += _STEP
    return best


def find_waves(u: FloatArray, y: FloatArray, law: FloatArray) -> list[tuple[Wave, FloatArray]]:
    """Return the best teeth and the best sine beside a law, each with its size.

    Parameters
    ----------
    u : (N,) array
        Places, rising from 0 to 1 [1].
    y : (N,) array
        Values [unit].
    law : (N,) array
        Shape of the law along u, fitted together with the wave [1].

    Returns
    -------
    list of (Wave, (C,) array)
        The wave and the factors of its columns [unit].
    """
    base = np.column_stack([np.ones(len(u)), law])
    rest = y - base @ np.linalg.lstsq(base, y, rcond=None)[0]
    found = _search(u, rest, np.array(_CHIRPS), _SHORTEST)
    waves = []
    for row, toothed in zip(found, (True, False), strict=True):
        if row[0] > 0.0:
            place = _refine(row[1:], u, y, base, toothed=toothed)
            wave = _wave(place, toothed=toothed)
            if toothed:
                wave = _move_edges(wave, u, y, base)
            waves.append((wave, _fit(wave, u, y, base)[1]))
    return waves


def _fit(wave: Wave, u: FloatArray, y: FloatArray, base: FloatArray) -> tuple[float, FloatArray]:
    """Return the square sum that wave and law leave, and the factors of the wave's columns."""
    matrix = np.column_stack([base, wave.columns(u)])
    factors = np.asarray(np.linalg.lstsq(matrix, y, rcond=None)[0], np.float64)
    off = y - matrix @ factors
    return float(off @ off), factors[base.shape[1] :]


def _refine(
    first: FloatArray, u: FloatArray, y: FloatArray, base: FloatArray, *, toothed: bool
) -> FloatArray:
    """Move periods, chirp and phase to where the fit together with the law leaves least."""
    place = first.copy()
    steps = np.array([0.5 * _STEP, 0.1, 0.5 / _BINS if toothed else 0.0])
    least = _fit(_wave(place, toothed=toothed), u, y, base)[0]
    for _ in range(_ROUNDS):
        for k, sign in itertools.product(range(3), (1.0, -1.0)):
            while steps[k] > 0.0:
                tried = place.copy()
                tried[k] += sign * steps[k]
                if tried[0] < 0.5 * FEWEST or abs(tried[1]) > _STEEPEST:
                    break
                power = _fit(_wave(tried, toothed=toothed), u, y, base)[0]
                if not power < least:
                    break
                place, least = tried, power
        steps *= 0.5
    return place


def _move_edges(wave: Wave, u: FloatArray, y: FloatArray, base: FloatArray) -> Wave:
    """Move every edge of the teeth by up to a few values to where the fit leaves least."""
    turns, least = wave.turns.copy(), _fit(wave, u, y, base)[0]
    spacing = float(u[-1] - u[0]) / (len(u) - 1)
    for _ in range(_EDGE_ROUNDS):
        moved = False
        inner = range(1, len(turns) - 1)
        for k, step in itertools.product(inner, (0.5, -0.5, 1.0, -1.0, 2.0, -2.0)):
            tried = turns.copy()
            tried[k] += step * spacing
            if len(inner) > 1:  # the teeth at the ends are as long as their neighbours
                tried[0] = min(2.0 * tried[1] - tried[2], 0.0)
                tried[-1] = max(2.0 * tried[-2] - tried[-3], 1.0)
            if not np.all(np.diff(tried) > 2.0 * spacing):
                continue
            power = _fit(Wave(tried, toothed=True), u, y, base)[0]
            if power < least:
                turns, least, moved = tried, power, True
        if not moved:
            break
    return Wave(turns, toothed=True)
