# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the cycles of a valve cannot show: faults that their own scatter hides."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.verdict import Verdict, VerdictKind
from valve_twin.core.diagnosis.changes.kept import kept
from valve_twin.core.diagnosis.config import detection_of
from valve_twin.core.diagnosis.history import followed, products_of
from valve_twin.core.diagnosis.table import BY_NAME, SHOWN_BY
from valve_twin.core.diagnosis.watch.whitened import known_by, whitened

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.config import DetectionConfig
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.past.columns import Past
    from valve_twin.core.types import FloatArray

_MEDIUM = 1
"""Place of the medium size among the sizes of a fault: what hides no such is not told."""

_MOST = 3
"""Most faults that are told."""


def with_hidden(verdict: Verdict, past: Past) -> Verdict:
    """Return a verdict, an "ok" with the faults that the cycles cannot show.

    Parameters
    ----------
    verdict : Verdict
        By all else.
    past : Past
        All estimates of the valve.
    """
    hidden = hidden_in(past) if verdict.kind is VerdictKind.OK else ""
    return replace(verdict, evidence=f"{verdict.evidence}; {hidden}") if hidden else verdict


def hidden_in(past: Past) -> str:
    """Return which faults the newest product's cycles cannot show, and what would; or "".

    Parameters
    ----------
    past : Past
        All estimates of the valve.

    Returns
    -------
    str
        One line; empty where medium faults of all kinds show, or the model has no features of
        its own.
    """
    known = followed(past)
    if known is None or known[0].feature_set.of_any_valve:
        return ""
    model, table, shown = known
    config = detection_of(model.feature_set)
    product = products_of(shown)
    own = np.flatnonzero(product == product[-1])[: config.learn + config.recent]
    if len(own) < config.least + config.confirm:
        return ""
    vectors = model.feature_set.vectors(shown.take(own).usable)
    sizes = _least_shown(vectors, table, config)
    named = [f"{_text(fault, size)} ({SHOWN_BY[fault]})" for fault, size in sizes[:_MOST]]
    return f"what these cycles do not show: {', '.join(named)}" if named else ""


def _text(fault: str, size: float) -> str:
    """Return a fault that does not show up to a size, infinite = at none."""
    kind = BY_NAME[fault]
    unit = "" if kind.unit == "1" else f" {kind.unit}"
    return f"{kind.text} below {size:.2g}{unit}" if np.isfinite(size) else kind.text


@kept
def _least_shown(
    vectors: FloatArray, table: SignatureTable, config: DetectionConfig
) -> list[tuple[str, float]]:
    """Return the faults whose medium size does not show in `confirm` cycles, and what size does.

    Worst first; infinite where no size of the table does.
    """
    rays = whitened(vectors, known_by(len(vectors), config), len(vectors), table, config)[2]
    length = np.linalg.norm(rays.changes, axis=1)
    least = float(np.sqrt(config.threshold / config.confirm))
    found = []
    for fault in table.faults:
        rows = [k for k, s in enumerate(table.signatures) if s.fault == fault and s.severity > 0.0]
        size = np.array([table.signatures[k].severity for k in rows])
        far = np.maximum.accumulate(length[rows])
        if len(rows) > _MEDIUM and far[_MEDIUM] < least and fault in SHOWN_BY:
            shown = np.interp(least, far, size, right=np.inf)
            found.append((float(shown / size[_MEDIUM]), fault, float(shown)))
    return [(fault, shown) for _, fault, shown in sorted(found, reverse=True)]
