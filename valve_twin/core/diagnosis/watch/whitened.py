# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Cycles in standard deviations of the first ones, while the record grows."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from valve_twin.core.diagnosis.lines import (
    REACH,
    Rays,
    filled,
    filled_on,
    whitened_rays,
    without_outliers,
)
from valve_twin.core.diagnosis.watch.growing import Growing
from valve_twin.core.diagnosis.watch.straight import Sums

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.config import DetectionConfig
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.types import BoolArray, FloatArray

View: TypeAlias = "tuple[FloatArray, FloatArray, Rays]"
"""Whitened cycles, the same without outliers, and the whitened signatures."""


class Whitened:
    """Cycles in standard deviations of the first ones; more may be added.

    Parameters
    ----------
    vectors : (N, F) array
        Features as they are followed [unit by feature].
    known : int
        How many of the first cycles say how the valve scatters.
    table : SignatureTable
        Signatures of the valve's faults.
    config : DetectionConfig
        When to speak.

    Attributes
    ----------
    rays : Rays
        Whitened signatures.
    """

    def __init__(
        self, vectors: FloatArray, known: int, table: SignatureTable, config: DetectionConfig
    ) -> None:
        y = filled(vectors, config.least)
        self._level = y[:known].mean(axis=0)
        self._config, self._last = config, y[-1].copy()
        y -= self._level
        seen = np.isfinite(vectors)
        self.rays = whitened_rays(y[:known], seen, table, config, level=self._level)
        self._given = np.count_nonzero(seen[: config.least], axis=0) >= config.least // 2
        width = vectors.shape[1]
        self._w, self._base = Growing(width), Growing(width)
        self._past = Sums.none(width)
        self._total = Growing(width, np.zeros((1, width)))
        self._whole = Growing(1, self._is_whole(seen))
        self._put(y)

    def __len__(self) -> int:
        """Return the number of cycles."""
        return len(self._w)

    def grow(self, vectors: FloatArray) -> None:
        """Take the rows of (N, F) features that come behind those known."""
        new = vectors[len(self) :]
        if len(new):
            y = filled_on(self._last, new, self._given)
            self._last = y[-1].copy()
            self._whole.put(len(self), self._is_whole(np.isfinite(new)))
            self._put(y - self._level)

    def _is_whole(self, seen: BoolArray) -> FloatArray:
        """Return whether cycles show every feature that is there, (M, 1)."""
        return np.asarray((seen | ~self._given).all(axis=1, keepdims=True), np.float64)

    def _put(self, y: FloatArray) -> None:
        """Add cycles; whether the last one is an outlier is told by the next."""
        count, w = len(self), self.rays.whitened(y)
        self._w.put(count, w)
        self._total.add_up(count, w)
        open_from = max(count - 1, 0)
        since = max(open_from - REACH, 0)
        base = without_outliers(self._w.rows[since:], self._config)[open_from - since :]
        self._base.put(open_from, base)
        self._past.put(open_from, base)

    @property
    def view(self) -> View:
        """The cycles, the same without outliers, and the signatures; good until more come."""
        return self._w.rows, self._base.rows, self.rays

    @property
    def measured(self) -> FloatArray:
        """The cycles without outliers, (N, F); NaN where one does not show all features."""
        return np.where(self._whole.rows > 0.0, self._base.rows, np.nan)

    @property
    def past(self) -> Sums:
        """Sums of the cycles without outliers."""
        return self._past

    @property
    def total(self) -> FloatArray:
        """Sums of the first cycles, (N + 1, F)."""
        return self._total.rows


def whitened(
    vectors: FloatArray, known: int, end: int, table: SignatureTable, config: DetectionConfig
) -> View:
    """Return the first `end` cycles whitened by the scatter of the first `known`.

    Parameters
    ----------
    vectors : (N, F) array
        Features as they are followed [unit by feature].
    known, end : int
        Numbers of cycles.
    table : SignatureTable
        Signatures of the valve's faults.
    config : DetectionConfig
        When to speak.
    """
    return Whitened(vectors[:end], known, table, config).view


def known_by(count: int, config: DetectionConfig) -> int:
    """Return how many of the first cycles say how a valve scatters.

    Parameters
    ----------
    count : int
        Cycles that are there [1].
    config : DetectionConfig
        When to speak.
    """
    return min(config.learn, max(count - config.recent, config.least))
