# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Programs of equal duration that drive to other levels: recipes that are made in turn.

A model errs otherwise at another level, so that cycles of several levels scatter by that and hide
what a fault does to each of them. Levels tell a product only where they come in turn: one that
comes once and stays may be what a controller makes of a fault.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.products import wider_beside
from valve_twin.core.types import Parameter, ParameterValue

if TYPE_CHECKING:
    from valve_twin.core.past.columns import Rows
    from valve_twin.core.types import BoolArray, Cycle, FloatArray, IntArray
    from valve_twin.core.valves.interface import ValveModel

PROGRAM = "program."
"""With what the names of the numbers begin that tell how a cycle drives the valve."""

_APART = 0.05
"""Gap between the levels of two programs at least, over the usual spread of a command in a cycle,
assumed [1]."""

_ONE = 1e-9
"""Spread of a command over its mean below which it does not change: error of the mean [1]."""

_ASKED = 0.5
"""Share of the usual spread of a command from which on the valve is asked to move: less may be
within its dead band, assumed [1]."""

_FEWEST = 5
"""Fewest cycles of a program, as of a product."""

_ODD = 0.3
"""Share of cycles of no program above which levels tell none, as durations do, assumed [1]."""

_MOST = 8
"""Programs that are taken apart, the first that came, assumed; all others are one more product, so
that those are what they were when yet another one comes."""

_TURNS = 4
"""Changes from one program to another and back from which on they come in turn, assumed."""


def published(model: ValveModel) -> tuple[Parameter, ...]:
    """Return the numbers that tell a program, two for each command of a model.

    They are in the unit of the command, which only a configuration knows where it is no share.
    """
    unit = "1" if model.normalised else ""
    return tuple(
        Parameter(f"{PROGRAM}{name}.{what}", unit, f"how a cycle drives {name}: {text}")
        for name in model.inputs
        for what, text in (("mean", "its mean"), ("spread", "its standard deviation"))
    )


def values(model: ValveModel, cycle: Cycle) -> list[ParameterValue]:
    """Return mean and standard deviation of each command of a cycle [unit of the command].

    Parameters
    ----------
    model : ValveModel
        The valve's model.
    cycle : Cycle
        With at least one sample.
    """
    numbers: list[float] = []
    for column in cycle.frames.inputs[cycle.frames.valid].T:
        known = column[np.isfinite(column)]
        numbers += [float(known.mean()), float(known.std())] if len(known) else [math.nan] * 2
    pairs = zip(published(model), numbers, strict=True)
    return [ParameterValue(p.name, v) for p, v in pairs if math.isfinite(v)]


def asked(features: Rows, cycles: IntArray, since: int) -> BoolArray:
    """Return in which cycles the commands changed as much as to move the valve, (N,).

    Parameters
    ----------
    features : Rows
        Features of all cycles.
    cycles : (N,) int64 array
        Numbers of the cycles that are asked for; True where nothing is stored of one.
    since : int
        Number of the first cycle that does not tell what is usual.
    """
    found = np.zeros(len(cycles), dtype=np.bool_)
    names = [n for n in features.parameters if n.startswith(PROGRAM) and n.endswith(".spread")]
    for name in names:
        spread = features.value(name)
        usual = spread[(features.cycle < since) & (spread > 0.0)]
        least = _ASKED * float(np.median(usual)) if len(usual) else 0.0
        of = dict(zip(features.cycle.tolist(), spread.tolist(), strict=True))
        found |= np.array([not of.get(c, math.nan) < least for c in cycles.tolist()], dtype=bool)
    return found if names else ~found


def with_programs(product: IntArray, rows: Rows) -> IntArray:
    """Return products, those taken apart whose programs come in turn.

    Parameters
    ----------
    product : (N,) int64 array
        What each cycle makes by its duration, -1 = not known [1].
    rows : Rows
        Features of the N cycles; those without levels, of an older version, stay together.

    Returns
    -------
    (N,) int64 array
        Number of the product, -1 = not known; as given where no programs come in turn.
    """
    names = sorted(n for n in rows.parameters if n.startswith(PROGRAM))
    if not names:
        return product
    level = np.column_stack([rows.usable(n) for n in names])  # mean and spread by turns
    known = np.asarray(np.isfinite(level).all(axis=1))
    none = np.zeros(len(names) // 2)
    usual: FloatArray = np.median(level[known, 1::2], axis=0) if known.any() else none
    held: FloatArray = np.median(np.abs(level[known, ::2]), axis=0) if known.any() else none
    moves: BoolArray = usual > _ONE * held  # else it stays where it is, to the last bits
    driven = np.repeat(moves, 2)
    level = level[:, driven] / np.repeat(usual, 2)[driven]
    found, last = np.full_like(product, -1), -1
    for number in range(int(product.max(initial=-1)) + 1):
        own = np.flatnonzero(product == number)
        told = own[known[own]]
        made = _in_turn(level[told]) if driven.any() else None
        before = own if made is None else own[~known[own]]
        if made is not None:
            found[told] = np.where(made < 0, -1, last + 1 + made)
            last = int(found.max())
        if len(before) >= (1 if made is None else _FEWEST):  # stored before levels were
            last += 1
            found[before] = last
    return found


def _in_turn(level: FloatArray) -> IntArray | None:
    """Return the program of each cycle by its levels (N, K); -1 = too few, None = none in turn."""
    if len(level) < 2 * _FEWEST:
        return None
    labels = np.column_stack([_labels(column) for column in level.T])
    group = np.unique(labels, axis=0, return_inverse=True)[1].reshape(-1)
    sizes = np.bincount(group)
    odd = float(sizes[sizes < _FEWEST].sum())
    if np.count_nonzero(sizes >= _FEWEST) < 2 or odd > _ODD * len(level):
        return None
    first = np.unique(group, return_index=True)[1]
    made: list[BoolArray] = []
    others = np.zeros(len(level), dtype=np.bool_)
    at: list[FloatArray] = []
    for number in np.argsort(first):
        if sizes[number] < _FEWEST:
            continue
        own, here = group == number, level[group == number].mean(axis=0)
        near = int(np.argmin([np.linalg.norm(here - x) for x in at])) if at else -1
        is_new = near < 0 or _turns(made[near], own) >= _TURNS
        if is_new and len(made) < _MOST:
            made.append(own)
            at.append(here)
        elif is_new:
            others |= own
        else:
            made[near], at[near] = made[near] | own, here
    if len(made) < 2:
        return None
    found = np.full(len(level), -1, dtype=np.int64)
    for number, own in enumerate((*made, others)):
        found[own] = number
    return found


def _labels(level: FloatArray) -> IntArray:
    """Return numbers of the levels that lie apart, (N,), by values over the usual spread."""
    order = np.argsort(level, kind="stable")
    ranked = level[order]
    gap = np.diff(ranked)
    apart = gap > _APART
    apart[apart] = gap[apart] > wider_beside(ranked, apart)
    found = np.empty(len(level), dtype=np.int64)
    found[order] = np.concatenate(([0], np.cumsum(apart)))
    return found


def _turns(one: BoolArray, other: BoolArray) -> int:
    """Return how often cycles of one program follow such of another or the other way round."""
    both = one | other
    return int(np.count_nonzero(np.diff(one[both].astype(np.int8))))
