# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a design must keep, what it is judged by, and the front of those that nothing beats."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.quantity import assumed, check_quantities

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.types import FloatArray
    from valve_twin.design.search.tasks import Outcome

OBJECTIVES = ("rise_s", "graded_s", "loss")
"""Figures that are to become small, each over that of the reference."""

AGREE_S, AGREE, AGREE_OVERSHOOT = 2e-4, 0.03, 0.01
"""By how much rise and settling on two meshes may differ, whichever is more, and overshoot: goals
of ours [s], [1], [1]."""

WORST = 1.25
"""Reference point of the hypervolume: every objective over that of the reference [1]."""

_MOST = ("overshoot", "error", "loss", "heating")
"""Figures that a limit keeps from above."""

FAILED = 10.0
"""What stands for the objectives of a design that has none [1]."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What a design has to keep."""

    overshoot: float = assumed(0.05, "1", "Most overshoot of any step", 0.0, 1.0)
    error: float = assumed(0.02, "1", "Most that is left of any step at its end", 0.0, 1.0)
    loss: float = assumed(1.15, "1", "Most loss over that of the reference", 0.01, 100.0)
    heating: float = assumed(60.0, "K", "Most heating of the yoke over still air", 0.1, 500.0)
    margin: float = assumed(20.0, "N", "Least force left of the largest current", -1e3, 1e4)

    def __post_init__(self) -> None:
        """Refuse numbers outside their range."""
        check_quantities(self)

    def broken(self, of: Outcome, reference: Mapping[str, float]) -> dict[str, float]:
        """Return by how much each limit is broken over its size, 0 or less = kept [1].

        Parameters
        ----------
        of : Outcome
            A design.
        reference : mapping
            Figures of the reference.

        Returns
        -------
        dict
            By name; "window" are the restrictions of the geometry.
        """
        if of.error:
            return {"window": 1.0 + of.broken, **dict.fromkeys((*_MOST, "margin"), 1.0)}
        most = self._most(reference)
        over = {name: of.figures[name] / max(most[name], 1e-6) - 1.0 for name in _MOST}
        short = (self.margin - of.figures["margin"]) / max(abs(self.margin), 1.0)
        return {"window": 0.0, **over, "margin": short}

    def keeps(self, of: Outcome, reference: Mapping[str, float]) -> bool:
        """Return whether a design keeps all limits.

        Parameters
        ----------
        of : Outcome
            A design.
        reference : mapping
            Figures of the reference.
        """
        return not of.error and all(v <= 0.0 for v in self.broken(of, reference).values())

    def said(self, of: Outcome, reference: Mapping[str, float]) -> str:
        """Return which limits a design breaks, in words.

        Parameters
        ----------
        of : Outcome
            A design.
        reference : mapping
            Figures of the reference.
        """
        if of.error:
            return of.error
        bounds = {**self._most(reference), "margin": self.margin}
        words = [
            f"{name} = {of.figures[name]:.4g}: must be {bounds[name]:.4g} or "
            f"{'more' if name == 'margin' else 'less'}"
            for name, by in self.broken(of, reference).items()
            if by > 0.0
        ]
        return "; ".join(words)

    def _most(self, reference: Mapping[str, float]) -> dict[str, float]:
        """Return the largest values of the figures that are to be small."""
        most = {name: float(getattr(self, name)) for name in _MOST}
        return {**most, "loss": self.loss * reference["loss"]}


def objectives(of: Outcome, reference: Mapping[str, float]) -> FloatArray:
    """Return the objectives (3,) of a design over those of the reference [1].

    Parameters
    ----------
    of : Outcome
        A design.
    reference : mapping
        Figures of the reference.
    """
    if of.error:
        return np.full(len(OBJECTIVES), FAILED)
    shares = np.array([of.figures[name] / reference[name] for name in OBJECTIVES])
    return np.where(np.isfinite(shares), shares, FAILED)


def front_of(
    found: Sequence[Outcome], limits: Limits, reference: Mapping[str, float]
) -> tuple[Outcome, ...]:
    """Return the designs that keep the limits and that no other beats in every objective.

    Of designs that are alike in all objectives the last is returned.

    Parameters
    ----------
    found : sequence of Outcome
        Designs of one fidelity.
    limits : Limits
        What has to be kept.
    reference : mapping
        Figures of the reference.
    """
    kept = [of for of in found if limits.keeps(of, reference)]
    if not kept:
        return ()
    values = np.array([objectives(of, reference) for of in kept])
    no_worse = (values[:, None, :] <= values[None, :, :]).all(axis=2)
    better = (values[:, None, :] < values[None, :, :]).any(axis=2)
    beaten = np.flatnonzero((no_worse & better).any(axis=0)).tolist()
    found_at = {tuple(values[k].tolist()): of for k, of in enumerate(kept) if k not in beaten}
    return tuple(of for _, of in sorted(found_at.items(), key=lambda item: item[0]))


def agree(one: Outcome, other: Outcome) -> bool:
    """Tell whether rise, settling and overshoot of a design are alike on two meshes.

    Parameters
    ----------
    one, other : Outcome
        Of one design.
    """
    if one.error or other.error:
        return False
    a, b = one.figures, other.figures
    times = all(
        abs(a[name] - b[name]) <= max(AGREE_S, AGREE * abs(b[name])) + 1e-12
        for name in ("rise_s", "settling_s")
    )
    return times and abs(a["overshoot"] - b["overshoot"]) <= AGREE_OVERSHOOT


def hypervolume(front: Sequence[Outcome], reference: Mapping[str, float]) -> float:
    """Return the volume between a front and `WORST` in all objectives [1].

    Parameters
    ----------
    front : sequence of Outcome
        Of `front_of`.
    reference : mapping
        Figures of the reference.
    """
    from pymoo.indicators.hv import HV

    if not front:
        return 0.0
    values = np.array([objectives(of, reference) for of in front])
    return float(HV(ref_point=np.full(len(OBJECTIVES), WORST))(values))


def chosen_of(front: Sequence[Outcome], reference: Mapping[str, float]) -> Outcome:
    """Return the design whose worse of rise and graded settling, over the reference, is the best.

    Parameters
    ----------
    front : sequence of Outcome
        One or more.
    reference : mapping
        Figures of the reference.
    """
    return min(front, key=lambda of: float(objectives(of, reference)[:2].max()))
