# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Channels made from others ("p_a - p_b", "a + b", "max(cmd, 0)", "max(-cmd, 0)"); new steps."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.io.errors import BagError
from valve_twin.io.instruments.table import Column

if TYPE_CHECKING:
    from collections.abc import Iterable

    from valve_twin.core.types import FloatArray
    from valve_twin.io.instruments.table import Recording

_PART = re.compile(r"max\((-?)(.+), 0\)")
_GAP_STEPS = 10.0  # of the channel or of the new grid: a longer pause is left empty
_MOST_STEPS = 50_000_000
_REPORTED = 5.0  # long steps over short ones where values are stored as they change, assumed
_TENTH = 0.1  # quantile of the steps that counts as a short one, assumed
_SELDOM, _SILENT = 0.01, 3.0  # times the step that so few exceed a silence may last, assumed
_QUIET = 2.0  # usual changes between two reports within which a value stays unreported, assumed
_SWITCHED = 0.3  # share of the samples that repeat the one before: held, never averaged


def one_side(name: str, *, falling: bool = False) -> str:
    """Return the name of the part of a channel above 0, or of what lies below it.

    Parameters
    ----------
    name : str
        The channel.
    falling : bool
        Below 0, counted upwards.
    """
    return f"max({'-' if falling else ''}{name}, 0)"


def difference(first: str, second: str) -> str:
    """Return the name of the difference of two channels."""
    return f"{first} - {second}"


def is_made(name: str) -> bool:
    """Return whether a name describes a channel made from others.

    Parameters
    ----------
    name : str
        Of a channel.
    """
    return bool(_PART.fullmatch(name)) or " - " in name or " + " in name


def with_derived(recording: Recording, names: Iterable[str]) -> Recording:
    """Return a recording with the channels that these names describe; others stay as they are.

    A channel of exactly that name comes first. Of two channels with times of their own the
    second is interpolated at the times of the first.

    Parameters
    ----------
    recording : Recording
        What a file holds.
    names : iterable of str
        Channels, or what is made of them.
    """
    known = {c.name: c for c in recording.columns}
    made: dict[str, Column] = {}
    for name in names:
        found = None if name in known or name in made else _derive(name, known)
        if found is not None:
            made[name] = found
    return replace(recording, columns=(*recording.columns, *made.values()))


def _derive(name: str, known: dict[str, Column]) -> Column | None:
    part = _PART.fullmatch(name)
    if part and part[2] in known:
        column = known[part[2]]
        sign = -1.0 if part[1] else 1.0
        return replace(column, name=name, values=np.maximum(sign * column.values, 0.0))
    for sign, mark in ((-1.0, " - "), (1.0, " + ")):
        at = name.find(mark)
        while at >= 0:
            first, second = known.get(name[:at]), known.get(name[at + len(mark) :])
            if first is not None and second is not None:
                values = first.values + sign * _at(second, first.seconds)
                return Column(name, first.unit, first.seconds, values)
            at = name.find(mark, at + 1)
    return None


def _at(column: Column, seconds: FloatArray) -> FloatArray:
    if len(column.seconds) == len(seconds) and np.array_equal(column.seconds, seconds):
        return column.values
    good = np.isfinite(column.values)
    if not good.any():
        return np.full(len(seconds), np.nan)
    read: FloatArray = np.interp(
        seconds, column.seconds[good], column.values[good], left=np.nan, right=np.nan
    )
    return read


def resampled(recording: Recording, step_s: float) -> Recording:
    """Return all channels on one grid of equal steps.

    A measured channel that is denser than the grid is averaged over each step, a sparser one
    interpolated; a switched one is held. A pause of more than ten steps stays empty, but where
    values are reported when they change and it ends near where it began.

    Parameters
    ----------
    recording : Recording
        What a file holds.
    step_s : float
        The step [s].

    Raises
    ------
    BagError
        If the step does not fit the file.
    """
    last = max(float(c.seconds[-1]) for c in recording.columns)
    count = int(last / step_s + 1e-9) + 1
    if not 2 <= count <= _MOST_STEPS:
        msg = (
            f"{recording.path}: resample_s {step_s:g} gives {count} rows of {last:g} s; change it"
        )
        raise BagError(msg)
    grid = np.arange(count, dtype=np.float64) * step_s
    columns = tuple(
        replace(c, seconds=grid, values=_resample(c, grid, step_s)) for c in recording.columns
    )
    clock = f"{recording.clock}; resampled to {step_s:g} s"
    return replace(recording, columns=columns, clock=clock)


def is_reported(seconds: FloatArray) -> bool:
    """Return whether a channel is stored when it changes, not at steps that jitter or pause.

    Parameters
    ----------
    seconds : (N,) array
        Times of a channel, rising [s].
    """
    if len(seconds) < 3:
        return False
    short, long = np.quantile(np.diff(seconds), (_TENTH, 1.0 - _TENTH))
    return bool(long > _REPORTED * short)


def _resample(column: Column, grid: FloatArray, step_s: float) -> FloatArray:
    good = np.isfinite(column.values)
    seconds, values = column.seconds[good], column.values[good]
    out = np.full(len(grid), np.nan)
    if len(values) < 2:
        return out
    at = np.searchsorted(seconds, grid, side="right") - 1
    own_s = float(np.median(np.diff(seconds)))
    if float(np.mean(np.diff(values) == 0.0)) > _SWITCHED:
        out = np.where(at >= 0, values[np.maximum(at, 0)], np.nan)
    elif own_s > 0.75 * step_s:
        out = np.interp(grid, seconds, values, left=np.nan, right=np.nan)
    else:
        slot = np.rint(seconds / step_s).astype(np.int64)  # centred on the new time: no delay
        inside = (slot >= 0) & (slot < len(grid))
        number = np.bincount(slot[inside], minlength=len(grid))
        total = np.bincount(slot[inside], weights=values[inside], minlength=len(grid))
        out = np.where(number > 0, total / np.maximum(number, 1), np.nan)
        empty = number == 0
        out[empty] = np.interp(grid[empty], seconds, values, left=np.nan, right=np.nan)
    first, then = np.maximum(at, 0), np.minimum(at + 1, len(seconds) - 1)
    before, after = seconds[first], seconds[then]
    limit = _GAP_STEPS * max(step_s, own_s)
    empty = (after - before > limit) & (grid > before) & (grid < after)
    if is_reported(
        seconds
    ):  # silence then means that nothing changed, if it is no longer than any
        usual = float(np.median(np.abs(np.diff(values))))
        longest = _SILENT * float(np.quantile(np.diff(seconds), 1.0 - _SELDOM))
        moved = np.abs(values[then] - values[first]) > _QUIET * usual
        empty &= moved | (after - before > longest)
    out[empty] = np.nan
    out[grid > seconds[-1] + limit] = np.nan
    return out
