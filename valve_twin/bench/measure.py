# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""One comparison: how it is timed, held to its goal and said in a line."""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.types import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Scale:
    """How much is measured: `quick` for seconds, else minutes.

    Attributes
    ----------
    quick : bool
        Smaller inputs.
    repeats : int
        Repetitions whose median is taken [1].
    """

    quick: bool
    repeats: int


class Better(str, Enum):
    """In which sense the figure of a comparison and its goal are to be read."""

    HIGHER = "higher"
    LOWER = "lower"


@dataclass(frozen=True, slots=True)
class Ratio:
    """One comparison and its goal.

    Attributes
    ----------
    name, peer : str
        What is compared, and with what.
    ours_s, peer_s : float
        Their times [s].
    goal : float
        Of `value`, in the same sense [1].
    unmeasured : str
        Why there is no figure on a machine that is too busy for one.
    better : Better
        HIGHER: how many times less time ours takes than a peer that does the same. LOWER: how
        many times that of a peer that does less.
    """

    name: str
    peer: str
    ours_s: float
    peer_s: float
    goal: float
    unmeasured: str = ""
    better: Better = Better.HIGHER

    @property
    def value(self) -> float:
        """Peer over ours where higher is better, ours over peer where lower is [1]."""
        higher = self.better is Better.HIGHER
        return self.peer_s / self.ours_s if higher else self.ours_s / self.peer_s

    @property
    def reached(self) -> bool:
        """Whether the goal is reached."""
        return self.value >= self.goal if self.better is Better.HIGHER else self.value <= self.goal


def describe(ratio: Ratio, committed: float | None = None) -> str:
    """Return a comparison as one line, beside the ratio measured when it was committed."""
    if ratio.unmeasured:
        return f"{ratio.name}: not measured: {ratio.unmeasured}"
    before = "" if committed is None else f", committed {committed:.3g} x"
    reached = "reached" if ratio.reached else "not reached"
    return (
        f"{ratio.name}: {ratio.value:.3g} x {ratio.peer} (better is {ratio.better.value}, "
        f"goal {ratio.goal:.3g} x{before}; "
        f"{ratio.ours_s * 1e3:.3g} ms against {ratio.peer_s * 1e3:.4g} ms) goal {reached}"
    )


def median(
    action: Callable[[], object], repeats: int, clock: Callable[[], float] = time.process_time
) -> float:
    """Return the median time of an action after a warm-up [s], CPU time unless told otherwise.

    Parameters
    ----------
    action : callable
        What is timed.
    repeats : int
        Repetitions after the warm-up [1].
    clock : callable
        Returns the time [s].
    """
    action()
    times = []
    for _ in range(repeats):
        begin = clock()
        action()
        times.append(clock() - begin)
    return max(statistics.median(times), 1e-9)


def require_equal(
    ours: FloatArray | IntArray, peer: FloatArray | IntArray, what: str, whom: str
) -> None:
    """Refuse to compare the times of different results.

    Parameters
    ----------
    ours, peer : (N,) arrays
        Results of any unit; `numpy.array_equal` compares them.
    what, whom : str
        What differs, and from whose, for the error.
    """
    if not np.array_equal(ours, peer, equal_nan=True):
        msg = f"the {what} differ from those of {whom}"
        raise AssertionError(msg)
