# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which column of a table carries the time, in which unit, and what stands for it if none does."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.quantity import suggest
from valve_twin.io.errors import BagError
from valve_twin.io.instruments.table import Column, Recording, rising, unique, wild_row
from valve_twin.io.instruments.units import known_unit, roles_of, split_name
from valve_twin.io.tables.csv_doubts import clock_notices

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import FloatArray
    from valve_twin.io.instruments.cells import RawColumn, Sheet

_RISES = 0.98  # share of the steps of a time column that go up
_REGULAR = 0.9  # share of the steps of an unnamed time column that are the usual one
_RATE = re.compile(
    r"(?:sampl\w*|abtast\w*|scan|log)\W*(?:rate|frequen\w*|freq|sfrequenz)\D{0,20}?"
    r"([\d.,]+(?:e[-+]?\d+)?)\s*(k?)(?:hz|s/s|1/s|$)",
    re.IGNORECASE,
)
_STEP = re.compile(
    r"(?:sampl\w*|abtast\w*|scan|log\w*|x[-_ ]?increment|delta[-_ ]?t|\bdt\b|interval)"
    r"\W*(?:interval|period|time|increment|intervall|zeit)?\D{0,20}?"
    r"([\d.,]+(?:e[-+]?\d+)?)\s*(ms|us|µs|sec|s|min)\b",
    re.IGNORECASE,
)
_COUNTED = "rows are counted: the file states no time"
_DAY_S = 86_400.0


@dataclass(frozen=True, slots=True)
class ClockChoice:
    """What a user or a configuration says of the time.

    Attributes
    ----------
    column : str
        The column that carries it; empty = found.
    scale : float
        Seconds in one unit of it; 0 = found [s].
    period_s : float
        Time between two rows of a file without times; 0 = one that the preamble states, else 1 s.
    resample_s : float
        Put all channels on one grid of this step; 0 = as they are [s].
    """

    column: str = ""
    scale: float = 0.0
    period_s: float = 0.0
    resample_s: float = 0.0


def with_clock(sheet: Sheet, choice: ClockChoice) -> Recording:
    """Return the columns of a table with their times.

    Parameters
    ----------
    sheet : Sheet
        Columns of numbers and dates.
    choice : ClockChoice
        What is known of the time.

    Raises
    ------
    BagError
        If the column named is not there or holds no time.
    """
    columns = _one_date(sheet.columns)
    at = _chosen(sheet, columns, choice.column) if choice.column else _find(columns)
    count = len(sheet.lines)
    if at is None:
        period_s, clock = _period(sheet.preamble, choice.period_s)
        seconds = np.arange(count, dtype=np.float64) * period_s
        measured = clock != _COUNTED and not choice.period_s
        if clock == _COUNTED:
            clock = _useless(columns) or clock
        return _recording(sheet, columns, seconds, clock, measured=measured)
    time = columns[at]
    scale, clock, measured = _scale(time, choice.scale)
    keep = rising(time.values)
    notices = list(sheet.notices)
    if not keep.all():
        bad = int(np.argmin(keep))
        told = wild_row(time.values, keep)
        notices.append(f"{sheet.path}:{sheet.lines[bad]}: column '{time.name}': {told}")
    if time.dated and not time.zoned:
        notices += clock_notices(sheet.path, sheet.lines[keep], time.values[keep])
    if np.count_nonzero(keep) < 2:
        msg = f"{sheet.path}: column '{time.name}' does not rise; name the time column"
        raise BagError(msg)
    ticks = time.values[keep]
    seconds = (ticks - ticks[0]) * scale
    others = [replace(c, values=c.values[keep]) for i, c in enumerate(columns) if i != at]
    made = _recording(
        replace(sheet, notices=notices, lines=sheet.lines[keep]),
        others, seconds, clock, measured=measured,
    )  # fmt: skip
    dated = time.dated and ticks[0] > _DAY_S * 365
    start_ns = round(float(ticks[0]) * 1e6) * 1000 if dated else None
    return replace(made, start_ns=start_ns, time_column=time.name, time_scale=scale)


def _recording(
    sheet: Sheet, columns: Sequence[RawColumn], seconds: FloatArray, clock: str, *, measured: bool
) -> Recording:
    made = [
        Column(c.name, c.unit, seconds, c.values)
        for c in columns
        if not c.dated and np.isfinite(c.values).any()
    ]
    return Recording(sheet.path, unique(made), clock, measured, notices=tuple(sheet.notices))


def _one_date(columns: Sequence[RawColumn]) -> list[RawColumn]:
    """Join a column of days and the column of times of day beside it."""
    dated = [i for i, c in enumerate(columns) if c.dated]
    if len(dated) < 2:
        return list(columns)
    days, clock = (columns[i] for i in dated[:2])
    if np.nanmax(days.values) < _DAY_S * 365 or np.nanmax(clock.values) > _DAY_S * 365:
        return list(columns)
    hours = clock.values % _DAY_S
    both = replace(clock, name=f"{days.name} {clock.name}", values=days.values + hours)
    return [both if i == dated[0] else c for i, c in enumerate(columns) if i != dated[1]]


def _chosen(sheet: Sheet, columns: Sequence[RawColumn], name: str) -> int:
    names = [c.name for c in columns]
    if name not in names:
        msg = f"{sheet.path}: there is no column '{name}'; {suggest(name, names)}"
        raise BagError(msg)
    return names.index(name)


def _find(columns: Sequence[RawColumn]) -> int | None:
    """Return the column of the time: dates, a name with a unit, a name, regular steps."""
    ranks = []
    for at, column in enumerate(columns):
        steps = np.diff(column.values)
        if not len(steps) or float(np.mean(steps > 0)) < _RISES:
            continue
        name, unit = split_name(column.name)
        known = known_unit(column.unit or unit)
        timed = "time" in roles_of(name, "")
        if column.dated:
            ranks.append((0, at))
        elif known is not None and known.quantity == "time":
            ranks.append((1 if timed else 2, at))
        elif timed and (known is None or known.quantity == "number"):
            ranks.append((3, at))
        elif at == 0 and known is None and _regular(steps) and not _counts(column.values):
            ranks.append((4, at))
    return min(ranks)[1] if ranks else None


def _useless(columns: Sequence[RawColumn]) -> str:
    """Say which column looks like the time and cannot be it, empty where none does."""
    for column in columns:
        name, unit = split_name(column.name)
        known = known_unit(column.unit or unit)
        told = known is not None and known.quantity == "time"
        if not (column.dated or told or (known is None and "time" in roles_of(name, "")[:1])):
            continue
        steps = np.diff(column.values)
        if len(steps) and (risen := float(np.mean(steps > 0))) < _RISES:
            return (
                f"rows are counted: column '{column.name}' rises in {100.0 * risen:.3g} % of the "
                f"rows, {100.0 * _RISES:.0f} % would make it the time"
            )
    return ""


def _counts(values: FloatArray) -> bool:
    """Whether a column numbers its rows."""
    return bool(np.all(np.diff(values) == 1.0))


def _regular(steps: FloatArray) -> bool:
    usual = float(np.median(steps))
    return float(np.mean(np.abs(steps - usual) < 0.1 * usual)) > _REGULAR


def _scale(time: RawColumn, given: float) -> tuple[float, str, bool]:
    """Return seconds in a unit of the time column, in words, and whether the file states it."""
    if time.dated:
        zone = "" if time.zoned else "; no zone is stated, taken for UTC"
        return 1.0, f"column '{time.name}' (dates{zone})", True
    known = known_unit(time.unit)
    if given:
        stated = known is not None and known.quantity == "time" and known.size == given
        return given, f"column '{time.name}' in units of {given:g} s", stated
    if known is not None and known.quantity == "time":
        return known.size, f"column '{time.name}' [{time.unit}]", True
    steps = np.diff(time.values)
    whole = bool(np.all(time.values == np.rint(time.values)))
    scale = 1e-3 if whole and len(steps) >= 1000 else 1.0
    unit = "milliseconds" if scale < 1.0 else "seconds"
    return scale, f"column '{time.name}', no unit stated: taken for {unit}", False


def _period(preamble: Sequence[str], given: float) -> tuple[float, str]:
    if given:
        return given, f"rows are {given:g} s apart, as given"
    for line in preamble:
        for pattern in (_STEP, _RATE):
            found = pattern.search(line)
            if not found:
                continue
            try:
                value = float(found[1].replace(",", "."))
            except ValueError:
                continue
            if pattern is _RATE:
                value = 1.0 / (value * (1000.0 if found[2] else 1.0)) if value else 0.0
            else:
                unit = known_unit(found[2])
                value *= unit.size if unit else 1.0
            if value > 0.0:
                return value, f"rows are {value:g} s apart, says '{line.strip()[:60]}'"
    return 1.0, _COUNTED
