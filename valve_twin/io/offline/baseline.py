# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a model is worth beside models that know nothing of valves: ARX, and a line.

Computed from an offline run alone, over its newest cycles; the live twin does none of it.
"""

from __future__ import annotations

import math
import statistics
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from valve_twin.core.estimation.solvers.arx import fit_arx, line_fit
from valve_twin.core.prediction import fit_percent
from valve_twin.core.types import EstimateStatus
from valve_twin.core.valves.kit.record import held, longest_whole

if TYPE_CHECKING:
    from valve_twin.core.types import Cycle, FloatArray
    from valve_twin.io.offline.run import Record

ERROR = "free run, test"
"""Which error is compared: from the model's inputs alone, over a cycle that it does not know."""

_DELAYS = (0, 1, 2, 4, 8)  # tried [samples]
_MOST = 2000  # samples of a cycle; a longer one is thinned
_LEAST = 50  # samples of a cycle that a baseline is fitted to
_TIE = 1.0  # points of fit that decide nothing, assumed [%]


@dataclass(frozen=True, slots=True)
class Baselines:
    """Free-run fits over cycles that each model did not know, medians [%].

    Attributes
    ----------
    cycles : int
        Cycles compared, each by models of the cycle before.
    model, arx, line : float
        The valve's own model, ARX, a line through the inputs; NaN = none. All of them see the
        inputs that the model's free run is computed from, and no other.
    """

    cycles: int
    model: float
    arx: float
    line: float

    @property
    def worse(self) -> bool:
        """Whether a baseline follows clearly better than the model."""
        best = max((f for f in (self.arx, self.line) if math.isfinite(f)), default=-math.inf)
        return best > max(self.model, 0.0) + _TIE

    @property
    def text(self) -> str:
        """What was found, in a sentence or two."""
        told = (
            f"Fit of the {ERROR} (each cycle by models of the one before, median of "
            f"{self.cycles}): this model {_percent(self.model)}, ARX {_percent(self.arx)}, a line "
            f"through the inputs {_percent(self.line)}."
        )
        if self.worse:
            told += (
                " A baseline that knows nothing of valves follows better: do not rely on this "
                "model's parameters before model, signals and scales are checked."
            )
        return told

    def fields(self, valve: str) -> dict[str, Any]:
        """Return a line of JSON as plain data; a fit that is not known is null."""
        fits = {"model_fit": self.model, "arx_fit": self.arx, "line_fit": self.line}
        known = {k: v if math.isfinite(v) else None for k, v in fits.items()}
        return {
            "kind": "baseline",
            "valve": valve,
            "error": ERROR,
            "cycles": self.cycles,
            **known,
            "worse_than_baseline": self.worse,
        }


def _percent(fit: float) -> str:
    return f"{fit:.1f} %" if math.isfinite(fit) else "none"


def compare_baselines(record: Record) -> Baselines | None:
    """Compare the model with its baselines over the newest cycles; None = nothing to compare.

    Parameters
    ----------
    record : Record
        What an offline run found.
    """
    own = {
        e.cycle: e.fit_test
        for e in record.estimates
        if e.used_by_trend and e.status is not EstimateStatus.REFUSED and math.isfinite(e.fit_test)
    }
    rows = []
    for before, cycle in pairwise(record.newest):
        if cycle.number not in own or not record.driven:
            continue
        fits = _fits(before, cycle, record.driven)
        if fits is not None:
            rows.append((own[cycle.number], *fits))
    if not rows:
        return None
    return Baselines(len(rows), *(_median(column) for column in zip(*rows, strict=True)))


def _median(values: tuple[float, ...]) -> float:
    known = [v for v in values if math.isfinite(v)]
    return statistics.median(known) if known else math.nan


def _fits(before: Cycle, cycle: Cycle, driven: list[int]) -> tuple[float, float] | None:
    """Return the fits of ARX and of a line of one cycle on the next [%]."""
    (u, y), (unseen_u, unseen_y) = _columns(before, driven), _columns(cycle, driven)
    if min(len(y), len(unseen_y)) < _LEAST:
        return None
    every = -(-max(len(y), len(unseen_y)) // _MOST)
    u, y, unseen_u, unseen_y = u[::every], y[::every], unseen_u[::every], unseen_y[::every]
    model = fit_arx(u, y, _DELAYS)
    arx = math.nan
    if model is not None:
        arx = fit_percent(unseen_y, model.free_run(unseen_u, unseen_y))
    return arx, line_fit(u, y, unseen_u, unseen_y)


def _columns(cycle: Cycle, driven: list[int]) -> tuple[FloatArray, FloatArray]:
    """Return what the free run sees (N, M) and the position (N,), longest part without a gap."""
    if not len(cycle.frames):
        return np.empty((0, len(driven))), np.empty(0)
    part, known = longest_whole(cycle.frames, cycle.period_s)
    return held(part.inputs[:, driven], known), held(part.position, known)
