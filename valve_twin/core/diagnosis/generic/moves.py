# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The moves of a cycle, found in the response of the model, which has no noise."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray

_MOVING = 0.02
"""Share of the greatest speed of a cycle above which it moves, assumed [1]."""

_LEAST = 0.1
"""Share of the span that a move covers at least, assumed [1]."""

_WINDOW = 10
"""Most samples before and behind a move that say where it began and ended, assumed."""


@dataclass(frozen=True, slots=True)
class Move:
    """A move of the response: samples `first` to `last`, behind that of `earlier`, before `next`.

    `way` is where it goes, as a share of the span with its sign [1].
    """

    earlier: int
    first: int
    last: int
    next: int
    way: float

    @property
    def whole(self) -> slice:
        """Move and the beginning of the rest behind it, as long as the move."""
        return slice(self.first, min(self.next, 2 * self.last - self.first + _WINDOW))

    @property
    def before(self) -> slice:
        """The last samples before it."""
        return slice(max(self.earlier, self.first - _WINDOW), self.first + 1)

    @property
    def behind(self) -> slice:
        """The last samples of the rest behind it that are near its end."""
        end = min(self.next, 2 * self.last - self.first + 2 * _WINDOW)
        return slice(max(self.last, end - _WINDOW), end)


def find_moves(response: FloatArray) -> tuple[tuple[Move, ...], BoolArray]:
    """Return the moves of a response, and at which samples it stands still.

    Parameters
    ----------
    response : (N,) array
        Response of the model over its span [1], all finite.

    Returns
    -------
    tuple of Move
        In their order.
    (N,) bool array
        Neither in a move nor in a smaller motion.
    """
    speed = np.gradient(response)
    moving = np.abs(speed) > _MOVING * np.abs(speed).max(initial=0.0)
    way = np.where(moving, np.sign(speed), 0.0)
    edges = np.flatnonzero(np.diff(way, prepend=0.0, append=0.0) != 0.0)
    runs = [(int(a), int(b) - 1) for a, b in pairwise(edges) if way[a]]
    span = float(np.ptp(response))
    ways = [float(response[b] - response[a]) for a, b in runs]
    kept = [(run, w) for run, w in zip(runs, ways, strict=True) if abs(w) >= _LEAST * span > 0.0]
    begins = [a for (a, _), _ in kept[1:]] + [len(response)]
    ends = [0] + [b for (_, b), _ in kept[:-1]]
    moves = tuple(
        Move(earlier, a, b, then, w)
        for earlier, ((a, b), w), then in zip(ends, kept, begins, strict=False)
    )
    return moves, ~moving
