# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The error budget on the page: a stacked bar a parameter, and the numbers below."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from markupsafe import escape

from valve_twin.report.svg import drawing
from valve_twin.report.tables import Table
from valve_twin.report.text import NONE, noted, number, render

if TYPE_CHECKING:
    from valve_twin.core.valves.error_budget import Budget, BudgetRow

_COLOURS = {
    "a": "#9ecae1",
    "b": "#6baed6",
    "c": "#c6dbef",
    "d": "#fdd0a2",
    "e": "#fdae6b",
    "f": "#e6842a",
    "g": "#c7b9dd",
    "h": "#a1d99b",
    "i": "#74c476",
    "j": "#c7e9c0",
    "k": "#d9a9c4",
}
_OTHER = "#c9ced4"
"""Colours of the rows: offsets blue, noise orange, approximations the rest; letters as well."""

_LEFT, _WIDTH, _RIGHT = 250.0, 640.0, 110.0
_STEP, _BAR = 30.0, 20.0
_LETTER_ROOM = 16.0


def budget_section(budget: Budget | None) -> str:
    """Return heading, bars and table as HTML; empty without a budget."""
    if budget is None:
        return ""
    return render("budget.html", budget=budget, bars=budget_bars(budget), numbers=_numbers(budget))


def budget_bars(budget: Budget) -> str:
    """Return the stacked bars, one a parameter, as an SVG element."""
    width = _LEFT + _WIDTH + _RIGHT
    height = _STEP * len(budget.columns) + 6.0
    parts = []
    for k, column in enumerate(budget.columns):
        top = 3.0 + _STEP * k
        middle = top + 0.5 * _BAR + 4.0
        name = escape(f"{column.parameter} ({column.estimator.replace('_', ' ')})")
        parts.append(f'<text class="end" x="{_LEFT - 9:.1f}" y="{middle:.1f}">{name}</text>')
        total = budget.total(k)
        left = _LEFT
        for row in budget.rows:
            share = row.errors[k] / total if total > 0.0 else 0.0
            if math.isfinite(share) and share > 0.0:
                parts.append(_segment(row, left, top, share, row.errors[k]))
                left += share * _WIDTH
        text = _percent(total)
        parts.append(f'<text x="{_LEFT + _WIDTH + 9:.1f}" y="{middle:.1f}">{text}</text>')
    return drawing(width, height, parts, "Error budget by parameter", "wide budget")


def _segment(row: BudgetRow, left: float, top: float, share: float, error: float) -> str:
    """Return one part of a bar, with its letter where there is room."""
    wide = share * _WIDTH
    fill = _COLOURS.get(row.letter, _OTHER)
    drawn = (
        f'<rect x="{left:.1f}" y="{top:.1f}" width="{wide:.1f}" height="{_BAR:g}" '
        f'fill="{fill}" stroke="#fff"><title>({row.letter}) {escape(row.text)}: '
        f"{escape(_percent(error))}</title></rect>"
    )
    if wide < _LETTER_ROOM:
        return drawn
    x, y = left + 0.5 * wide, top + 0.5 * _BAR + 4.0
    return f'{drawn}<text class="mid" x="{x:.1f}" y="{y:.1f}">{row.letter}</text>'


def _numbers(budget: Budget) -> Table:
    """Return the table: relative errors in percent."""
    names = [noted(c.parameter, c.estimator.replace("_", " ")) for c in budget.columns]
    rows = [
        [f"({row.letter}) {row.text}", number(row.size, 2), *map(_percent, row.errors)]
        for row in budget.rows
    ]
    for title, total in (
        ("Sum of all", budget.total),
        ("Root of the sum of squares", budget.root_sum_square),
    ):
        rows.append([title, "", *(_percent(total(k)) for k in range(len(names)))])
    caption = "Root mean square change of a parameter, relative to its value."
    return Table(["Source", "Size", *names], rows, caption)


def _percent(error: float) -> str:
    """Return a relative error in percent, two digits; refused = a dash."""
    if not math.isfinite(error):
        return NONE
    percent = 100.0 * error
    if percent < 0.01:
        return "< 0.01 %" if percent > 0.0 else "0 %"
    return f"{percent:.2g} %" if percent < 100.0 else f"{percent:.0f} %"
