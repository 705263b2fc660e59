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
    from valve_twin.core.types import BoolArray, FloatArray, IntArray

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
        self._shown = Growing(width, self._is_shown(seen))
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
            self._shown.put(len(self), self._is_shown(np.isfinite(new)))
            self._put(y - self._level)

    def _is_shown(self, seen: BoolArray) -> FloatArray:
        """Return 1 where cycles show a feature or it is never there, else 0, (M, F)."""
        return np.asarray(seen | ~self._given, np.float64)

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
        return np.where(self._is_whole()[:, None], self._base.rows, np.nan)

    def _is_whole(self) -> BoolArray:
        """Return which cycles show every feature that is there, (N,)."""
        return np.asarray(self._shown.rows.all(axis=1), dtype=np.bool_)

    def shown_along(
        self, off: FloatArray, rows: IntArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return how far cycles lie off along each ray by what they show, and what that tells.

        A feature that one does not show has the value of an earlier one: nothing that confirms it.

        Parameters
        ----------
        off : (K, F) array
            By what they lie off [standard deviations].
        rows : (K,) int array
            Which cycles they are.

        Returns
        -------
        (K, S) array
            How far [standard deviations].
        (K, S) array
            The share of a change along the ray that they show, 1 = all [1].
        (K, S) array
            Variance of how far healthy ones lie off, 1 where all is shown [1].
        """
        rays, white = self.rays.rays, self.rays.white
        along, share = self.rays.along(off), np.ones((len(rows), len(rays)))
        variance, shown = share.copy(), self._shown.rows[rows]
        partly = np.flatnonzero(~shown.all(axis=1))
        raw = np.linalg.inv(white) if len(partly) else white
        for k in partly:
            seen = rays @ (white * shown[k]) @ raw
            along[k], share[k] = seen @ off[k], np.sum(seen * rays, axis=1)
            variance[k] = np.sum(seen**2, axis=1)
        return along, share, variance

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
