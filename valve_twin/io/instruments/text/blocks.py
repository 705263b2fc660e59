# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The body of a large text table in blocks, each read by numpy where its rows are all alike."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.io.instruments.cells import POINTED, Block, Told
from valve_twin.io.instruments.dates import LONGEST, is_date

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import Any

    from numpy.typing import NDArray

    from valve_twin.io.instruments.cells import Layout, Rows

_HEAD = 400
"""Lines above the body, by which the table is found."""

_SOME = 400
"""Places all over the body from which a line is looked at."""

_TAIL = 60
"""Last lines that are looked at."""

BLOCK = 1 << 22
"""Bytes that are read at once [B]."""

_POINTED = re.compile(rb"(?<![\w.,:+-])" + POINTED.pattern.encode() + rb"(?![\w.,:])", re.ASCII)
"""A cell whose points may divide thousands."""

_QUOTED = re.compile(rb'"(?![-+]?[1-9]\d{0,2},\d{3}")[-+]?[\d.]*,\d+(?:[eEdD][-+]?\d+)?"')
"""A cell whose comma stands before decimals."""

_OTHER_BREAKS = (b"\x0b", b"\x0c", b"\x1c", b"\x1d", b"\x1e", b"\x00")
"""What Python takes for the end of a line, too, and what no text holds."""


@dataclass(frozen=True, slots=True)
class Body:
    """The lines of a text file behind its first ones: ASCII, each ended by a line feed.

    `start` is where they begin in the file [B], `line` the number of the first.
    """

    data: bytes
    start: int
    line: int

    def some(self) -> list[str]:
        """Return whole lines from all over the body, then its last ones."""
        found = []
        for place in np.linspace(self.start, len(self.data) - 1, _SOME, endpoint=False):
            begin = self.data.find(b"\n", int(place)) + 1
            end = self.data.find(b"\n", begin)
            if 0 < begin < end:
                found.append(self.data[begin:end])
        begin = len(self.data)
        for _ in range(_TAIL + 1):
            begin = max(self.data.rfind(b"\n", self.start, begin), self.start)
        return [line.decode("ascii") for line in [*found, *self.data[begin:].splitlines()]]

    def blocks(self) -> Iterator[tuple[int, bytes]]:
        """Yield whole lines, some megabytes at a time, and the number of the first of each."""
        begin, line = self.start, self.line
        while begin < len(self.data):
            end = self.data.find(b"\n", min(begin + BLOCK, len(self.data)) - 1) + 1
            block = self.data[begin : end or len(self.data)]
            yield line, block
            begin, line = begin + len(block), line + block.count(b"\n")

    def reads_commas(self, mark: str, layout: Layout, some: Rows, *, comma: bool) -> bool:
        """Return whether `read_fast` may take the commas of the body for what they were found.

        Parameters
        ----------
        mark : str
            What stands between cells.
        layout : Layout
            What the table looks like.
        some : sequence of (int, sequence of str)
            Rows from all over it.
        comma : bool
            Whether they stand before decimals.
        """
        if not comma:
            if mark == ",":
                return not _QUOTED.search(self.data)
            return self.data.find(b",", self.start) < 0
        if _POINTED.search(self.data):
            return False
        dates = (c[i] for _, c in some for i in layout.dated if i < len(c))
        return mark != "," and all(is_date(d.replace(",", ".")) for d in dates if d.strip())


def plain_body(data: bytes) -> Body | None:
    """Return the body of a text file; None = it is short, or no plain ASCII."""
    start, line = 0, 1
    while line <= _HEAD:
        start, line = data.find(b"\n", start) + 1, line + 1
        if not start:
            return None
    rest = data[start:]
    odd = any(mark in rest for mark in _OTHER_BREAKS)
    if odd or not rest.isascii() or rest.count(b"\r") != rest.count(b"\r\n"):
        return None
    return Body(data, start, line)


def read_fast(block: bytes, mark: str, layout: Layout, line: int, *, comma: bool) -> Block | None:
    """Return what whole rows of numbers hold; None = not all of them are such.

    Parameters
    ----------
    block : bytes
        ASCII lines.
    mark : str
        What stands between cells.
    layout : Layout
        What the table looks like.
    line : int
        Number of the first.
    comma : bool
        Whether commas stand before decimals; `mark` is none then.
    """
    kinds: list[tuple[str, str]] = [(str(i), "S1") for i in range(layout.width)]
    for i in layout.numeric:
        kinds[i] = (str(i), f"S{LONGEST}" if i in layout.dated else "f8")
    text = (block.replace(b",", b".") if comma else block).decode("ascii")
    if text.isspace():  # of which numpy warns
        return None
    try:
        found = np.loadtxt(
            io.StringIO(text),
            np.dtype(kinds),
            comments=None,
            delimiter=None if mark == " " else mark,
            quotechar='"' if '"' in text and mark != " " else None,
            ndmin=1,
        )
    except ValueError:
        return None
    if len(found) != block.count(b"\n") + (not block.endswith(b"\n")):
        return None
    columns: dict[int, NDArray[Any]] = {}
    for i in layout.numeric:
        values = found[str(i)]
        if i in layout.dated:
            cells = np.char.strip(values)
            longest = max(int(np.char.str_len(cells).max()), 1)
            columns[i] = cells.astype(f"S{longest}")
        else:
            columns[i] = values.copy()
    return Block(np.arange(line, line + len(found)), columns, Told())
