# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Dates and times of day as instruments write them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.io.errors import BagError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from valve_twin.core.types import FloatArray, IntArray

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
_DAY_S = 86_400.0
LONGEST = 64
"""Characters of a date with all that may stand in it; others are none."""


def is_date(cell: str) -> bool:
    """Whether a cell is a date, a date with a time, or a time of day."""
    text = cell.strip()
    return bool(_DATE.fullmatch(text) or _CLOCK.fullmatch(text))


def read_dates(
    path: Path, lines: IntArray, name: str, cells: NDArray[np.bytes_]
) -> tuple[FloatArray, bool]:
    """Return the times of a column of dates and whether they state their zone.

    Days stand before months where a point divides them or a first number is above 12, else months
    before days where a slash divides them. Without a zone they are taken for UTC.

    Parameters
    ----------
    path : Path
        The file, for messages.
    lines : (N,) array
        Line of every row.
    name : str
        The column.
    cells : (N,) array of bytes
        Dates, or times of day, which go on past midnight, in UTF-8.

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
    forms = list(_forms(cells))
    whole = [_DATE.fullmatch(form.example) for form in forms]
    day_first = any(
        m and m["a"] and (m["mark"] == "." or form.number(*m.span("a")).max() > 12)
        for form, m in zip(forms, whole, strict=True)
    )
    seconds, bad = np.full(len(cells), np.nan), len(cells)
    for form, match in zip(forms, whole, strict=True):
        if not form.example:
            continue
        found = _seconds(form, match, day_first=day_first)
        wrong = np.flatnonzero(np.isnan(found))
        bad = min(bad, int(form.rows[wrong[0]]) if len(wrong) else bad)
        seconds[form.rows] = found
    if bad < len(cells):
        msg = (
            f"{path}:{lines[bad]}: column '{name}': '{_text(cells[bad])[:40]}' is no date and "
            "time; correct it or remove the row"
        )
        raise BagError(msg)
    if not any(whole):
        seconds = _past_midnight(seconds)
    first = next(((f, m) for f, m in zip(forms, whole, strict=True) if f.example), None)
    clock = "" if first is None else (first[1]["clock"] or "" if first[1] else first[0].example)
    stated = _CLOCK.fullmatch(clock)
    return seconds, bool(stated and stated[6])


@dataclass(frozen=True, slots=True)
class _Form:
    """Cells that differ in their digits alone.

    `example` is the first of them, `rows` (M,) which they are of all, whose characters are
    `letters` (N, L).
    """

    example: str
    rows: IntArray
    letters: NDArray[np.uint8]

    def number(self, first: int, last: int) -> IntArray:
        """Return the numbers (M,) that characters `first` to `last` - 1 stand for."""
        found = np.zeros(len(self.rows), dtype=np.int64)
        for k in range(first, last):
            found = 10 * found + self.letters[self.rows, k].astype(np.int64) - ord("0")
        return found


def _forms(cells: NDArray[np.bytes_]) -> Iterator[_Form]:
    """Yield cells by their form, in the order of the first of each, up to one that is no date."""
    letters = np.ascontiguousarray(cells).view(np.uint8).reshape(len(cells), -1)
    digit = (letters >= ord("0")) & (letters <= ord("9"))
    shape = np.where(digit, np.uint8(ord("0")), letters)
    left = np.arange(len(cells))
    while len(left):
        alike = (shape[left] == shape[left[0]]).all(axis=1)
        example = _text(cells[left[0]])
        yield _Form(example, left[alike], letters)
        if example and not is_date(example):
            return
        left = left[~alike]


def as_cells(texts: Iterable[str]) -> NDArray[np.bytes_]:
    """Return texts as `read_dates` takes them; of what is too long for a date the beginning."""
    return np.array([text[:LONGEST].encode() for text in texts], dtype=np.bytes_)


def _text(cell: bytes) -> str:
    return cell.decode(errors="replace")


def _seconds(form: _Form, match: re.Match[str] | None, *, day_first: bool) -> FloatArray:
    """Return the times (N,) of cells of one form [s]; NaN = is none."""
    if match is None:
        return _of_day(form, form.example, 0)
    if match["y"]:
        year, month, day = (form.number(*match.span(k)) for k in ("y", "m", "d"))
    else:
        first, second, year = (form.number(*match.span(k)) for k in ("a", "b", "c"))
        day, month = (first, second) if day_first else (second, first)
        year = np.where(year < 100, year + 2000, year)
    sound = (year >= 1) & (month >= 1) & (month <= 12) & (day >= 1)
    months = (np.where(sound, 12 * (year - 1970) + month - 1, 0)).astype("datetime64[M]")
    sound &= day <= ((months + 1).astype("datetime64[D]") - months).astype(np.int64)
    days = months.astype("datetime64[D]").astype(np.int64) + day - 1
    seconds = days * _DAY_S
    if match["clock"]:
        seconds = seconds + _of_day(form, match["clock"], match.start("clock"))
    return np.where(sound, seconds, np.nan)


def _of_day(form: _Form, text: str, at: int) -> FloatArray:
    """Return the times of day (N,) that stand from character `at` on [s]; NaN = is none."""
    stripped = text.lstrip()
    at += len(text) - len(stripped)
    match = _CLOCK.fullmatch(stripped.rstrip())
    if match is None:
        return np.full(len(form.rows), np.nan)

    def number(group: int) -> IntArray:
        first, last = match.span(group) if match[group] else (0, 0)
        return form.number(at + first, at + last)

    hour, minute, second = number(1), number(2), number(3)
    if match[5]:
        hour = hour % 12 + (12 if match[5].lower() == "pm" else 0)
    sound = (hour <= 23) & (minute <= 59) & (second <= 60)
    away = np.zeros(len(form.rows))
    if match[6] and match[6] not in {"Z", "UTC"}:
        begin, end = at + match.start(6) + 1, at + match.end(6)
        away = form.number(begin, begin + 2) * 3600.0 + form.number(end - 2, end) * 60.0
        away = -away if match[6][0] == "-" else away
    part = number(4) / 10.0 ** len(match[4] or "")
    return np.where(sound, hour * 3600.0 + minute * 60.0 + second + part - away, np.nan)


def _past_midnight(seconds: FloatArray) -> FloatArray:
    steps = np.diff(seconds, prepend=seconds[:1])
    days = np.cumsum(np.where(steps < -0.5 * _DAY_S, 1.0, 0.0))
    later: FloatArray = seconds + days * _DAY_S
    return later
