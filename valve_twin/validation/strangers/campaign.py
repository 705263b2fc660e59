# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The campaign of strangers: many presses that the twin has never seen, scored together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from valve_twin.validation.strangers.draw import draw
from valve_twin.validation.strangers.score import Score, score
from valve_twin.validation.strangers.watch import watch

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from valve_twin.validation.strangers.draw import Stranger
    from valve_twin.validation.strangers.watch import Setup

SCORED_BASE = 900_000
"""First of the frozen seeds: they are scored, never tuned on."""

SCORED_COUNT = 200


@dataclass(frozen=True, slots=True)
class Met:
    """One stranger and its score."""

    stranger: Stranger
    score: Score


def seeds(base: int = SCORED_BASE, count: int = SCORED_COUNT) -> range:
    """Return the seeds of a campaign.

    Raises
    ------
    ValueError
        If the count is not above 0, or the base is negative.
    """
    if count < 1 or base < 0:
        msg = f"seeds {base} .. {base + count - 1}: give a base of 0 or more and 1 seed or more"
        raise ValueError(msg)
    return range(base, base + count)


def meet(
    chosen: Sequence[int], setup: Setup, *, advance: Callable[[], None] = lambda: None
) -> Iterator[Met]:
    """Show the strangers of some seeds to the twin, one by one.

    Parameters
    ----------
    chosen : sequence of int
        Seeds.
    setup : Setup
        How the twin is configured.
    advance : callable
        Called after each.
    """
    for seed in chosen:
        stranger = draw(seed)
        yield Met(stranger, score(stranger, watch(stranger, setup)))
        advance()


class Scored(Protocol):
    """One stranger of any family, with its score."""

    @property
    def score(self) -> Score:
        """Its score."""


def pooled(met: Sequence[Scored]) -> Score:
    """Return the score of all strangers together."""
    whole = Score()
    for one in met:
        whole.add(one.score)
    return whole
