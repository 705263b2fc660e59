# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Numbers, dates and words as they stand on the page, and the templates that they go into.

What is HTML already is `Markup`; a template escapes all else.
"""

from __future__ import annotations

import math
from datetime import datetime, timezone
from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

_CALENDAR_NS = 10**18
"""Stamps below (September 2001) are those of a clock that was not set, e.g. of a simulation."""

NONE = "–"
MINUS = "\u2212"


def noted(value: object, note: object) -> Markup:
    """Return a cell: a value, and a remark in small letters below it where there is one."""
    return Markup("{}<small>{}</small>" if note else "{}").format(value, note)


def number(x: float, digits: int = 4) -> str | Markup:
    """Return a number with `digits` significant digits; a dash for NaN, a sign for infinity."""
    if math.isnan(x):
        return NONE
    if math.isinf(x):
        return "∞" if x > 0 else f"{MINUS}∞"
    if x == 0.0:
        return "0"
    exponent = math.floor(math.log10(abs(x)))
    if -4 <= exponent < max(digits, 6):
        return f"{x:.{max(digits - 1 - exponent, 0)}f}".replace("-", MINUS)
    mantissa = f"{x / 10.0**exponent:.{digits - 1}f}".replace("-", MINUS)
    return Markup("{}·10<sup>{}</sup>").format(mantissa, str(exponent).replace("-", MINUS))


def fixed(x: float, decimals: int, *, sign: bool = False) -> str:
    """Return a number with so many decimals, a zero without a sign; a dash if not finite.

    Parameters
    ----------
    x : float
        Number [any unit].
    decimals : int
        Digits behind the point [1].
    sign : bool
        Whether a plus sign is written.
    """
    if not math.isfinite(x):
        return str(number(x))
    text = f"{x:{'+' if sign else ''}.{decimals}f}"
    return text.replace("-", MINUS) if text.strip("+-0.") else text.lstrip("+-")


def with_interval(value: float, lower: float, upper: float) -> str | Markup:
    """Return a value, and below it its interval, with decimals that fit the interval's width.

    Parameters
    ----------
    value, lower, upper : float
        Value and its interval [any unit]; NaN = not known.
    """
    if math.isnan(value):
        return NONE
    if not (math.isfinite(lower) and math.isfinite(upper) and upper > lower):
        return number(value)
    decimals = 1 - math.floor(math.log10(upper - lower))
    if not 0 <= decimals <= 8:
        a, b, c = number(value), number(lower), number(upper)
    else:
        a, b, c = (fixed(x, decimals) for x in (value, lower, upper))
    return noted(a, Markup("{} … {}").format(b, c))


def percent(value: float, lower: float, upper: float) -> str | Markup:
    """Return a change in percent with its interval.

    Parameters
    ----------
    value, lower, upper : float
        Change and its interval [%]; NaN = not known.
    """
    if math.isnan(value):
        return NONE
    known = math.isfinite(lower) and math.isfinite(upper)
    interval = f"{fixed(lower, 1, sign=True)} … {fixed(upper, 1, sign=True)}" if known else ""
    return noted(f"{fixed(value, 1, sign=True)} %", interval)


def count(n: int) -> str:
    """Return a whole number in groups of three."""
    return f"{n:,}".replace(",", "\u202f")


def unit(name: str) -> str:
    """Return a unit in brackets, empty for a dimensionless one."""
    return "" if name in {"", "1"} else f" [{name}]"


def utc(stamp_ns: int) -> datetime:
    """Return a stamp of a clock that is set as a moment."""
    return datetime.fromtimestamp(stamp_ns / 1e9, tz=timezone.utc)


def when(stamp_ns: int) -> str:
    """Return date and time (UTC) of a stamp, or the time since zero of a clock that is not set."""
    if stamp_ns < _CALENDAR_NS:
        total = stamp_ns // 10**9
        hours, minutes = divmod(total // 60, 60)
        return f"{hours}:{minutes:02d}:{total % 60:02d} on the data's clock"
    return utc(stamp_ns).strftime("%Y-%m-%d %H:%M:%S UTC")


def day(stamp_ns: int) -> str:
    """Return the date (UTC) of a stamp, or the time of a clock that is not set."""
    if stamp_ns < _CALENDAR_NS:
        return when(stamp_ns)
    return utc(stamp_ns).strftime("%Y-%m-%d")


@cache
def _templates() -> Environment:
    made = Environment(
        loader=PackageLoader("valve_twin.report"), autoescape=True, undefined=StrictUndefined
    )
    filters = (count, number, unit, when)
    made.filters.update({f.__name__: f for f in filters})
    return made


def render(template: str, **values: object) -> Markup:
    """Return a template of this package filled with values.

    Parameters
    ----------
    template : str
        File in `templates`.
    **values : object
        What it names; text is escaped, `Markup` is not.

    Returns
    -------
    Markup
        HTML.
    """
    return Markup(_templates().get_template(template).render(values))
