# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The campaign of strangers of the generic verdict, scored together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from valve_twin.validation.any_strangers.draw import draw
from valve_twin.validation.any_strangers.score import score
from valve_twin.validation.any_strangers.watch import watch

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from valve_twin.validation.any_strangers.draw import Stranger
    from valve_twin.validation.any_strangers.watch import Setup, Told
    from valve_twin.validation.strangers.score import Score

SCORED_BASE = 72_000
"""First of the seeds of the first table: nothing is tuned on them."""

SCORED_COUNT = 12


@dataclass(frozen=True, slots=True)
class Met:
    """One stranger, the model that it was given, all that was told of it, and its score."""

    stranger: Stranger
    model: str
    told: list[Told]
    score: Score


def meet(
    chosen: Sequence[int],
    configured: Callable[[Stranger], Setup],
    *,
    advance: Callable[[], None] = lambda: None,
) -> Iterator[Met]:
    """Show the strangers of some seeds to a twin, one by one.

    Parameters
    ----------
    chosen : sequence of int
        Seeds.
    configured : callable
        How the twin of a stranger is configured.
    advance : callable
        Called after each.
    """
    for seed in chosen:
        stranger = draw(seed)
        setup = configured(stranger)
        told = watch(stranger, setup)
        yield Met(stranger, setup.model.name, told, score(stranger, told))
        advance()
