# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The servosystem's bench record: hysteresis loops of the valve under a swinging current."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.bench_fit import (
    BenchFit,
    BenchPlot,
    BenchResult,
    BenchValue,
    Column,
    with_interval,
)
from valve_twin.core.valves.servo_system.loops import Loop

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.types import FloatArray

_BRANCH = 400  # points of a branch of a resampled loop
_DEAD = 0.2  # of half the swing, within which a change of side does not count [1], assumed
_FEWEST_ON_BRANCH = 10
_SMOOTHED = 20  # part of a branch over which noise is averaged: 1/20, assumed


def split_loops(current: FloatArray, position: FloatArray) -> list[Loop]:
    """Return the whole loops of a record, each from crest to crest of the current.

    Parameters
    ----------
    current, position : (N,) arrays
        Current [A] and valve position [m], some periods.

    Raises
    ------
    ValueError
        If there is no whole loop or a branch has too few samples.
    """
    middle = 0.5 * (current.max() + current.min())
    half = 0.5 * float(np.ptp(current))
    side = np.where(current > middle + _DEAD * half, 1, 0)
    side = np.where(current < middle - _DEAD * half, -1, side)
    clear = np.flatnonzero(side)
    turns = np.flatnonzero(np.diff(side[clear])) + 1
    runs = np.split(clear, turns)
    ends = [int(r[np.argmax(side[r[0]] * current[r])]) for r in runs]
    highs = [k for k, r in enumerate(runs) if side[r[0]] > 0]
    loops = []
    for first, last in pairwise(highs):
        down, up = (ends[first], ends[first + 1]), (ends[first + 1], ends[last])
        if min(down[1] - down[0], up[1] - up[0]) < _FEWEST_ON_BRANCH:
            message = (
                f"a branch of {min(down[1] - down[0], up[1] - up[0])} samples; "
                f"{_FEWEST_ON_BRANCH} or more are needed"
            )
            raise ValueError(message)
        at = np.concatenate([np.linspace(*down, _BRANCH), np.linspace(*up, _BRANCH)])
        index = np.arange(len(current))
        width = max(1, min(down[1] - down[0], up[1] - up[0]) // _SMOOTHED)
        smooth = [_averaged(values, width) for values in (current, position)]
        loops.append(Loop(*(np.interp(at, index, values) for values in smooth)))
    if not loops:
        message = "no whole loop: the current must swing from crest to crest at least once"
        raise ValueError(message)
    return loops


def _averaged(values: FloatArray, width: int) -> FloatArray:
    """Return means (N,) over `width` samples: noise would widen a loop."""
    padded = np.pad(values, (width // 2, width - 1 - width // 2), mode="edge")
    mean: FloatArray = np.convolve(padded, np.full(width, 1.0 / width), mode="valid")
    return mean


def hysteresis_loop(
    columns: Mapping[str, FloatArray], settings: Mapping[str, float | str]
) -> BenchResult:
    """Return width, area and travel of the loops; their intervals come from the scatter.

    Parameters
    ----------
    columns : mapping
        current [A], position [m], (N,) each.
    settings : mapping
        Not used.
    """
    del settings
    current, position = columns["current"], columns["position"]
    if np.ptp(current) == 0.0 or np.ptp(position) == 0.0:
        message = "current or position stands still: there is no loop"
        raise ValueError(message)
    loops = split_loops(current, position)
    found = {
        ("width", "A"): [loop.width for loop in loops],
        ("area", "A m"): [loop.area for loop in loops],
        ("travel", "m"): [float(np.ptp(loop.position)) for loop in loops],
        ("swing", "A"): [float(np.ptp(loop.current)) for loop in loops],
    }
    values = tuple(_mean(name, unit, each) for (name, unit), each in found.items())
    plot = BenchPlot(
        "current [mA]",
        "position [µm]",
        ((1e3 * current, 1e6 * position),),
        tuple((1e3 * loop.current, 1e6 * loop.position) for loop in loops),
    )
    remark = f"{len(loops)} whole loops"
    return BenchResult(values, (plot,), remark if len(loops) > 1 else f"{remark}: no interval")


def _mean(name: str, unit: str, each: list[float]) -> BenchValue:
    count = len(each)
    error = float(np.std(each, ddof=1) / np.sqrt(count)) if count > 1 else np.nan
    return with_interval(name, float(np.mean(each)), error, count - 1.0, unit)


BENCH_FITS = (
    BenchFit(
        "hysteresis-loop",
        "width, area and travel of loops of valve position over current",
        (
            Column("current", "current", "swings from crest to crest, some periods"),
            Column("position", "length", "of the valve"),
        ),
        hysteresis_loop,
    ),
)
"""Bench records of the valve of paper 003."""
