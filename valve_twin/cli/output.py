# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the verbs print on standard output: tables and JSON lines."""

from __future__ import annotations

import json
import math
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from rich.console import Console
    from rich.table import Table

WIDTH = 150
"""Columns where standard output is no terminal."""


def console(width: int = WIDTH) -> Console:
    """Return standard output as a console, so wide where it is no terminal [characters]."""
    from rich.console import Console

    found = Console(file=sys.stdout)
    return found if found.is_terminal else Console(file=sys.stdout, width=width)


def table(title: str, left: Iterable[str] = (), right: Iterable[str] = ()) -> Table:
    """Return an empty table.

    Parameters
    ----------
    title : str
        Line above it.
    left, right : iterable of str
        First columns, of words that are not wrapped, and further ones, of numbers.
    """
    from rich.table import Table

    made = Table(title=title, title_justify="left", pad_edge=False)
    for name in left:
        made.add_column(name, no_wrap=True)
    for name in right:
        made.add_column(name, justify="right")
    return made


def plain(value: object, infinite: str | None = "Infinity") -> object:
    """Return a value, and all in a dict, list or tuple, so that JSON can hold it.

    Parameters
    ----------
    value : object
        Value; NaN becomes null.
    infinite : str or None
        What an infinite number becomes, with a sign before a negative one; None = null.
    """
    if isinstance(value, dict):
        return {key: plain(v, infinite) for key, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v, infinite) for v in value]
    if not isinstance(value, float) or math.isfinite(value):
        return value
    if math.isnan(value) or infinite is None:
        return None
    return infinite if value > 0.0 else f"-{infinite}"


def print_json(values: Mapping[str, object]) -> None:
    """Print one JSON object on a line."""
    sys.stdout.write(f"{json.dumps(values, allow_nan=False)}\n")


def number(value: float, form: str) -> str:
    """Return a number in a format of Python's, a dash where it is not finite."""
    return format(value, form) if math.isfinite(value) else "-"
