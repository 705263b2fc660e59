# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A report as it is served: in the viewer's language, with the way back and times of his zone."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from valve_twin.gateway.pages import report_bar
from valve_twin.report.language.words import figures, whole_page

if TYPE_CHECKING:
    from valve_twin.gateway.pages import Visitor

_TIMES = re.compile(
    r"<svg.*?</svg>|<[^>]*>|(?P<day>\d{4}-\d\d-\d\d) (?P<time>\d\d:\d\d(?::\d\d)?) UTC", re.DOTALL
)


def served_report(page: str, valve: str, visitor: Visitor) -> str:
    """Return a report for a visitor.

    Parameters
    ----------
    page : str
        The report in English (HTML).
    valve : str
        Name of its valve.
    visitor : Visitor
        For whom.
    """
    told = figures(whole_page(page, visitor.language), visitor.language)
    bar = report_bar(valve, visitor)
    return _TIMES.sub(_zoned, told).replace("<body>", f"<body>{bar}", 1)


def _zoned(found: re.Match[str]) -> str:
    """Return a time as the script of the pages takes it; without scripts it stays UTC."""
    if found["day"] is None:
        return found.group()
    return f'<time datetime="{found["day"]}T{found["time"]}Z">{found.group()}</time>'
