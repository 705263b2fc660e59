# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Whether a product that is new is a reference: a fault may have come with it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.reference import NotYet
from valve_twin.core.estimation.data.robust import robust_sigma

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.features import FeatureSet
    from valve_twin.core.types import FloatArray, IntArray

_UNKNOWN = 2
"""Newest cycles in a row of no known product that are no accident, such as a pause."""

_LEAST = 5
"""Fewest cycles of either product that are compared."""

_MOST = 8
"""Last cycles before the change and first ones behind it that are compared."""

_TAIL = 4.0
"""Degrees of freedom: some products differ far more than most, assumed."""

_UNLIKE = 25.0
"""Twice the log likelihood ratio beyond which a change of product does not explain it; the
largest of 26 changes without a fault beside is 20 on strangers [1]."""


def doubt_of_product(product: IntArray) -> str:
    """Return that the newest cycles were compared with nothing: their product is not known yet.

    Parameters
    ----------
    product : (N,) int64 array
        What each cycle makes, -1 = not known [1].
    """
    unknown = int(np.argmax(np.append(product[::-1] >= 0, True)))
    if unknown < _UNKNOWN:
        return ""
    return NotYet(f"no reference yet: the newest {unknown} cycles are of no product that is known")


def doubt_across(
    cycles: IntArray, vectors: FloatArray, product: IntArray, kind: FeatureSet
) -> str:
    """Return that more came with the newest product than a change of product does, or "".

    Parameters
    ----------
    cycles : (N,) int64 array
        Cycle numbers since start or maintenance, rising.
    vectors : (N, F) array
        Features as they are followed [unit by feature].
    product : (N,) int64 array
        What each cycle makes, -1 = not known [1].
    kind : FeatureSet
        By how much features change with the product (`across`).
    """
    rows = np.flatnonzero(product >= 0)
    if not len(rows) or not kind.across:
        return ""
    own = rows[product[rows] == product[rows[-1]]][:_MOST]
    before = rows[rows < own[0]][-_MOST:]
    if min(len(own), len(before)) < _LEAST:
        return ""
    far, most, change = _far(vectors[before], vectors[own], kind)
    if far < _UNLIKE:
        return ""
    return (
        f"no reference: with the product that is made since cycle {cycles[own[0]]} {most} changed "
        f"by {change}, more than a product does: compare both with what is known to be right, "
        "then mark maintenance"
    )


def _far(before: FloatArray, now: FloatArray, kind: FeatureSet) -> tuple[float, str, str]:
    """Return how far two products are apart, the feature that shows most of it, its change."""
    whole, largest, most, change = 0.0, 0.0, "", ""
    for j, name in enumerate(kind.names):
        old, new = (x[np.isfinite(x[:, j]), j] for x in (before, now))
        if name not in kind.across or min(len(old), len(new)) < _LEAST:
            continue
        middle = float(np.median(old))
        off = float(np.median(new)) - middle
        spread = robust_sigma(old - middle)
        few = 1.0 / len(old) + 1.0 / len(new)
        value = (_TAIL + 1.0) * float(
            np.log1p(off**2 / (kind.across[name] ** 2 + spread**2 * few) / _TAIL)
        )
        whole += value
        if value > largest:
            relative = name in kind.relative
            largest, most = value, name
            change = f"{100.0 * np.expm1(off):+.0f} %" if relative else f"{off:+.2g}"
    return whole, most, change
