# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Whether a fault that was found in one product is still there in another that followed it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.data.robust import robust_sigma

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.features import FeatureSet
    from valve_twin.core.types import BoolArray, FloatArray, IntArray

LOOKED_AT = 5
"""First cycles of the products that followed which are compared."""

_LEAST = 2
_MOST = 8
_SURE = 6.0
"""Twice the log likelihood ratio that tells one from the other [1]."""

_TAIL = 4.0
"""Degrees of freedom: some products differ far more than most, assumed."""


class Elsewhere(Enum):
    """What products that followed say of a fault."""

    THERE = "it is still made, or it looks as with the fault"
    OVER = "it looks as before the fault"
    UNKNOWN = "nothing tells"


@dataclass(frozen=True, slots=True)
class Followed:
    """What came after the last cycle of the product in which a fault was found.

    Attributes
    ----------
    state : Elsewhere
        What it says.
    last : int
        Number of the last cycle of that product.
    seen : int
        Number of the cycle that settled it, -1 where none has.
    """

    state: Elsewhere
    last: int
    seen: int = -1


def followed_by(
    cycles: IntArray,
    vectors: FloatArray,
    own: BoolArray,
    onset: int,
    known: BoolArray,
    kind: FeatureSet,
) -> Followed:
    """Say whether a fault of one product is there in what followed.

    The features of the first cycles that followed lie nearer to those before the fault, or to
    those with it, within what a product changes (`FeatureSet.across`). Where that is not known,
    or too few cycles followed, the fault is taken to be there.

    Parameters
    ----------
    cycles : (N,) int64 array
        Cycle numbers, rising.
    vectors : (N, F) array
        Features of all products [unit by feature].
    own : (N,) bool array
        Cycles of the product in which it was found.
    onset : int
        Number of the first cycle with it.
    known : (N,) bool array
        Cycles of a product that is known.
    kind : FeatureSet
        Which features may be compared.
    """
    last = int(cycles[own][-1])
    later = np.flatnonzero((cycles > last) & known)
    if len(later) < LOOKED_AT or not kind.across:
        return Followed(Elsewhere.THERE, last)
    before = vectors[own & (cycles < onset)][-_MOST:]
    faulty = vectors[own & (cycles > onset)][-_MOST:]
    if not len(faulty):
        faulty = vectors[own & (cycles >= onset)]
    seen = int(cycles[later[LOOKED_AT - 1]])
    if len(before) < _LEAST or not len(faulty):
        return Followed(Elsewhere.UNKNOWN, last, seen)
    ratio = _ratio(before, faulty, vectors[later[:LOOKED_AT]], kind)
    state = Elsewhere.OVER if ratio > _SURE else Elsewhere.UNKNOWN
    return Followed(Elsewhere.THERE if ratio < -_SURE else state, last, seen)


def _ratio(before: FloatArray, faulty: FloatArray, now: FloatArray, kind: FeatureSet) -> float:
    """Return twice the log likelihood of "as before" over "as with the fault"."""
    whole = 0.0
    for j, name in enumerate(kind.names):
        columns = [x[np.isfinite(x[:, j]), j] for x in (before, faulty, now)]
        if name not in kind.across or min(len(c) for c in columns) < 1:
            continue
        right, wrong, new = (float(np.median(c)) for c in columns)
        spread = robust_sigma(columns[0] - right)
        few = sum(1.0 / len(c) for c in columns)
        variance = kind.across[name] ** 2 + spread**2 * few
        off = np.array([(new - right) ** 2, (new - wrong) ** 2]) / variance
        value = (_TAIL + 1.0) * np.log1p(off / _TAIL)
        whole += float(value[1] - value[0])
    return whole
