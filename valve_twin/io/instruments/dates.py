# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Dates and times of day as instruments write them."""

from __future__ import annotations

import re
from datetime import datetime, timedelta, timezone
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.io.errors import BagError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from valve_twin.core.types import FloatArray

_DATE = re.compile(
    r"(?:(?P<y>\d{4})[-/.](?P<m>\d{1,2})[-/.](?P<d>\d{1,2})"
    r"|(?P<a>\d{1,2})(?P<mark>[./-])(?P<b>\d{1,2})[./-](?P<c>\d{4}|\d{2}))"
    r"(?:[T ,;]+(?P<clock>.+))?",
    re.ASCII,
)
_CLOCK = re.compile(
    r"(\d{1,2}):(\d{2})(?::(\d{2})(?:[.,:](\d{1,9}))?)?\s*([AaPp][Mm])?"
    r"\s*(Z|UTC|[-+]\d{2}:?\d{2})?",
    re.ASCII,
)
_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
_DAY_S = 86_400.0


def is_date(cell: str) -> bool:
    """Whether a cell is a date, a date with a time, or a time of day."""
    text = cell.strip()
    return bool(_DATE.fullmatch(text) or _CLOCK.fullmatch(text))


def read_dates(
    path: Path, lines: Sequence[int], name: str, cells: Sequence[str]
) -> tuple[FloatArray, bool]:
    """Return the times of a column of dates and whether they state their zone.

    Days stand before months where a point divides them or a first number is above 12, else months
    before days where a slash divides them. Without a zone they are taken for UTC.

    Parameters
    ----------
    path, lines, name
        File, line of every row, and column, for messages.
    cells : sequence of str
        Dates, or times of day, which go on past midnight.

    Returns
    -------
    (N,) array
        Seconds since 1970, or since midnight where there are times of day only; NaN = empty cell.
    bool
        Whether a zone is stated.

    Raises
    ------
    BagError
        Names the first cell that is no date.
    """
    found = [_DATE.fullmatch(c) for c in cells]
    day_first = any(m and m["a"] and (m["mark"] == "." or int(m["a"]) > 12) for m in found)
    seconds = np.full(len(cells), np.nan)
    for at, (cell, match) in enumerate(zip(cells, found, strict=True)):
        if not cell:
            continue
        try:
            seconds[at] = _seconds(cell, match, day_first=day_first)
        except (ValueError, OverflowError):
            msg = (
                f"{path}:{lines[at]}: column '{name}': '{cell[:40]}' is no date and time; "
                "correct it or remove the row"
            )
            raise BagError(msg) from None
    if not any(found):
        seconds = _past_midnight(seconds)
    clock = next(
        (m["clock"] or "" if m else c for c, m in zip(cells, found, strict=True) if c), ""
    )
    stated = _CLOCK.fullmatch(clock)
    return seconds, bool(stated and stated[6])


def _seconds(cell: str, match: re.Match[str] | None, *, day_first: bool) -> float:
    if match is None:
        return _of_day(cell)
    if match["y"]:
        year, month, day = int(match["y"]), int(match["m"]), int(match["d"])
    else:
        first, second, year = int(match["a"]), int(match["b"]), int(match["c"])
        day, month = (first, second) if day_first else (second, first)
        year += 2000 if year < 100 else 0
    date = datetime(year, month, day, tzinfo=timezone.utc)
    return (date - _EPOCH).total_seconds() + (_of_day(match["clock"]) if match["clock"] else 0.0)


def _of_day(text: str) -> float:
    match = _CLOCK.fullmatch(text.strip())
    if match is None:
        raise ValueError(text)
    hour, minute, second = int(match[1]), int(match[2]), int(match[3] or 0)
    if match[5]:
        hour = hour % 12 + (12 if match[5].lower() == "pm" else 0)
    if hour > 23 or minute > 59 or second > 60:
        raise ValueError(text)
    zone = match[6] or "Z"
    away = timedelta(0)
    if zone not in {"Z", "UTC"}:
        digits = zone[1:].replace(":", "")
        away = timedelta(hours=int(digits[:2]), minutes=int(digits[2:]))
        away = -away if zone[0] == "-" else away
    part = float(f"0.{match[4]}") if match[4] else 0.0
    return hour * 3600.0 + minute * 60.0 + second + part - away.total_seconds()


def _past_midnight(seconds: FloatArray) -> FloatArray:
    steps = np.diff(seconds, prepend=seconds[:1])
    days = np.cumsum(np.where(steps < -0.5 * _DAY_S, 1.0, 0.0))
    later: FloatArray = seconds + days * _DAY_S
    return later
