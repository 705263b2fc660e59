# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a position loses by standing still while its model moves, and regains by jumps.

What sticks and what has play both stand still behind a reversal. Play takes up its width and then
follows at the pace of the model, as far behind as ever: it regains nothing. What sticks breaks
away and slips: it makes more way than the model until it has caught up with all or part of it -
the slip jump J beside the stick band S of the models of stiction by Choudhury and others, where
play is J = 0. Both ways are sums over a cycle, so that they need no fit and no free run through
slips that nobody can foretell.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.generic.features import span_of, step_of, thinned
from valve_twin.core.types import Parameter, ParameterValue

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.generic.features import Record

LOST, REGAINED = "stands.lost", "stands.regained"

PARAMETERS = (
    Parameter(LOST, "1", "way that the position did not make with its model, in spans", 0.0),
    Parameter(REGAINED, "1", "way that it made beyond its model, in spans", 0.0),
)
"""What these numbers are."""

_STEP = 0.03
"""Way of the model at its greatest speed within which ways are compared, assumed [span]."""

_FEWEST, _MOST_BETWEEN = 3, 60
"""Samples within which they are compared at least and at most, assumed."""

_CHANCE = 3.0
"""Standard deviations of a way by noise and rounding that tell nothing [1]."""

_ROUNDED = 12.0**0.5
_MEDIAN_OF_BENDS = 0.6745 * 6.0**0.5
"""Median size of second differences of noise over its standard deviation [1]."""


def stands(record: Record) -> dict[str, float]:
    """Return what a position lost and regained against its model; empty = not known.

    Parameters
    ----------
    record : Record
        Measured and expected.

    Returns
    -------
    dict of str to float
        By name, sums of ways over the cycle [span of the model's response].
    """
    record = thinned(record)
    y, m, span = record.position, record.response, span_of(record)
    if not span > 0.0:
        return {}
    known = record.known
    y, m = y[known] / span, m[known] / span
    between = int(np.clip(np.ceil(_STEP / np.abs(np.diff(m)).max()), _FEWEST, _MOST_BETWEEN))
    if len(m) <= 2 * between:
        return {}
    noise = float(np.median(np.abs(np.diff(y, 2)))) / _MEDIAN_OF_BENDS
    chance = _CHANCE * 2.0**0.5 * max(noise, step_of(y) / _ROUNDED)
    made, asked = np.abs(y[between:] - y[:-between]), np.abs(m[between:] - m[:-between])
    lost, regained = np.maximum(asked - made - chance, 0.0), np.maximum(made - asked - chance, 0.0)
    return {LOST: float(lost.sum()) / between, REGAINED: float(regained.sum()) / between}


def values(record: Record) -> list[ParameterValue]:
    """Return the same as parameters of an estimate."""
    return [ParameterValue(n, v) for n, v in stands(record).items()]
