# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the verbs print on standard output: tables and JSON lines."""

from __future__ import annotations

import json
import math
import re
import sys
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from rich.console import Console, ConsoleOptions, RenderableType
    from rich.table import Table

WIDTH = 150
"""Columns where standard output is no terminal."""

_ORDERS = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)
"""What a terminal obeys instead of showing it: controls, directions of writing, broken text."""


def shown(text: str) -> str:
    r"""Return a text with its line ends and tabs, and what a terminal would obey as `\x1b`."""
    return _ORDERS.sub(lambda found: ascii(found[0])[1:-1], text)


def write(text: str) -> None:
    """Write to standard output; a name of foreign origin gives the terminal no orders."""
    sys.stdout.write(shown(text))


def console(width: int = WIDTH) -> Console:
    """Return standard output as a console, so wide where it is no terminal [characters]."""
    from rich.console import Console
    from rich.segment import Segment

    class Showing(Console):
        """Gives the terminal the orders of tables, none of their words."""

        def render(
            self, renderable: RenderableType, options: ConsoleOptions | None = None
        ) -> Iterator[Segment]:
            for part in super().render(renderable, options):
                yield part if part.control else Segment(shown(part.text), part.style)

        def on_broken_pipe(self) -> NoReturn:
            """Leave it to who ends the verb, where rich ends the process with 1."""
            raise BrokenPipeError

    found = Showing(file=sys.stdout)
    return found if found.is_terminal else Showing(file=sys.stdout, width=width)


def table(
    title: str, left: Iterable[str] = (), right: Iterable[str] = (), last: Iterable[str] = ()
) -> Table:
    """Return an empty table.

    Parameters
    ----------
    title : str
        Line above it.
    left, right : iterable of str
        First columns, of words that are not wrapped, and further ones, of numbers.
    last : iterable of str
        Last columns, of words.
    """
    from rich.table import Table

    made = Table(title=title, title_justify="left", pad_edge=False)
    for name in left:
        made.add_column(name, no_wrap=True)
    for name in right:
        made.add_column(name, justify="right")
    for name in last:
        made.add_column(name)
    return made


def print_rows(shown: Table, rows: Iterable[Iterable[RenderableType]]) -> None:
    """Print a table with these rows of cells."""
    for row in rows:
        shown.add_row(*row)
    console().print(shown)


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
