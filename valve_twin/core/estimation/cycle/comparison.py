# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Several estimators of one cycle, held against each other."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.cycle.scatter import scatter_between_cycles
from valve_twin.core.types import Disagreement, Estimate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import ParameterValue


def compare_estimators(
    estimates: Sequence[Estimate],
    earlier: Sequence[Estimate],
    *,
    trend_estimator: str,
    trended: Sequence[str],
) -> tuple[Estimate, ...]:
    """Add to each estimate how far the others lie apart, and which one feeds the trend and why.

    Parameters
    ----------
    estimates : sequence of Estimate
        Of one cycle, one an estimator, with their standard errors.
    earlier : sequence of Estimate
        Those of the cycles before, oldest first.
    trend_estimator : str
        The one that feeds the trend.
    trended : sequence of str
        Parameters that are followed.
    """
    known = {e.estimator: {p.name: p for p in e.parameters if p.usable} for e in estimates}
    reason = _trend_reason(known, earlier, trend_estimator, trended)
    return tuple(
        replace(
            e,
            trend_reason=reason,
            disagreements=tuple(
                itertools.chain.from_iterable(
                    _between(known[e.estimator], known[other.estimator], other.estimator)
                    for other in estimates
                    if other.estimator != e.estimator
                )
            ),
        )
        for e in estimates
    )


def _between(
    own: dict[str, ParameterValue], others: dict[str, ParameterValue], other: str
) -> list[Disagreement]:
    found = []
    for name, value in own.items():
        against = others.get(name)
        if against is None:
            continue
        apart = value.value - against.value
        errors = [e for e in (value.standard_error, against.standard_error) if math.isfinite(e)]
        error = math.hypot(*errors) if errors else 0.0
        ratio = apart / error if error > 0.0 else math.nan
        found.append(Disagreement(other, name, apart, ratio if apart else 0.0))
    return found


def _trend_reason(
    known: dict[str, dict[str, ParameterValue]],
    earlier: Sequence[Estimate],
    trend_estimator: str,
    trended: Sequence[str],
) -> str:
    """Say which estimator feeds the trend, and how repeatable it is beside the others."""
    others = [
        name
        for name, values in known.items()
        if name != trend_estimator and any(p in values for p in trended)
    ]
    if not others:
        return ""
    rule = (
        f"{trend_estimator} always feeds the trend, so that no change of method looks like aging"
    )
    parts = []
    for parameter in trended:
        spread = {
            name: _relative_scatter(earlier, name, parameter)
            for name in (trend_estimator, *others)
        }
        finite = {name: s for name, s in spread.items() if math.isfinite(s)}
        if len(finite) > 1 and trend_estimator in finite:
            rest = ", ".join(f"{name} {s:.2g} %" for name, s in finite.items())
            parts.append(f"{parameter} {rest}")
    return f"{rule}; scatter between cycles: {'; '.join(parts)}" if parts else rule


def _relative_scatter(earlier: Sequence[Estimate], estimator: str, parameter: str) -> float:
    """Return the scatter of one parameter between cycles about its drift [% of its median]."""
    values = np.array(
        [
            p.value
            for e in earlier
            if e.estimator == estimator
            for p in e.parameters
            if p.name == parameter and p.usable
        ]
    )
    sigma = scatter_between_cycles(values).sigma
    middle = abs(float(np.median(values))) if len(values) else 0.0
    return 100.0 * sigma / middle if middle > 0.0 else math.nan
