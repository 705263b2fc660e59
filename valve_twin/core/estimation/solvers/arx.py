# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Baselines that every physical model is compared with: a line through the command, and ARX."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.prediction import fit_percent
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

ORDERS = (1, 2, 3)
"""Orders of an ARX model that are tried."""

_UNSTABLE = 1.0 - 1e-9  # greatest pole of a free run that does not run away


@dataclass(frozen=True, slots=True)
class Arx:
    """A linear difference equation.

    y[n] = level - sum a[i] y[n-i] + sum b[m, j] u[n-delay-j, m]

    Attributes
    ----------
    a : (P,) array
        Feedback, from y[n-1] on [1].
    b : (M, P) array
        Of the delayed commands [output/input].
    level : float
        Constant [output].
    delay : int
        Samples.
    """

    a: FloatArray
    b: FloatArray
    level: float
    delay: int

    def free_run(self, u: FloatArray, y: FloatArray) -> FloatArray:
        """Return the (N,) output to commands alone, begun from the first measured samples.

        Parameters
        ----------
        u : (N,) or (N, M) array
            Commands [their units].
        y : (N,) array
            Output, of which only the first samples are used [its unit].
        """
        order, n = len(self.a), len(u)
        drive = np.full(n, self.level)
        for b, one in zip(self.b, u.reshape(n, -1).T, strict=True):
            late = np.concatenate([np.full(self.delay + order - 1, one[0]), one])
            drive += np.convolve(late, b, "valid")[:n]
        whole = np.concatenate([y[:order], drive[order:]])
        _run_on(self.a, whole)
        return whole


@njit(cache=True)
def _run_on(a: FloatArray, y: FloatArray) -> None:
    """Let each value after the first P, now its drive alone, follow from the P before it."""
    for n in range(len(a), len(y)):
        for i in range(len(a)):
            y[n] -= a[i] * y[n - 1 - i]


def fit_arx(
    u: FloatArray, y: FloatArray, delays: tuple[int, ...], *, orders: tuple[int, ...] = ORDERS
) -> Arx | None:
    """Return the stable ARX model whose free run fits best where it was trained.

    Parameters
    ----------
    u : (N,) or (N, M) array
        Commands [their units].
    y : (N,) array
        Output [its unit].
    delays : tuple of int
        Tried [samples].
    orders : tuple of int
        Tried, each at least 1.

    Returns
    -------
    Arx or None
        None where none is stable.
    """
    best: tuple[float, Arx] | None = None
    for order, delay in itertools.product(orders, sorted(set(delays))):
        first = order + delay
        rows = len(y) - first
        if rows < 4 * order + 4:
            continue
        past = [-y[first - i : len(y) - i] for i in range(1, order + 1)]
        drive = [
            one[first - delay - j : len(one) - delay - j]
            for one in u.reshape(len(u), -1).T
            for j in range(order)
        ]
        table = np.column_stack([*past, *drive, np.ones(rows)])
        theta: FloatArray = np.linalg.lstsq(table, y[first:], rcond=None)[0].astype(np.float64)
        a = theta[:order]
        if np.abs(np.roots(np.concatenate([[1.0], a]))).max() > _UNSTABLE:
            continue
        made = Arx(a, theta[order:-1].reshape(-1, order), float(theta[-1]), delay)
        fit = fit_percent(y, made.free_run(u, y))
        if np.isfinite(fit) and (best is None or fit > best[0]):
            best = fit, made
    return None if best is None else best[1]


def line_fit(u: FloatArray, y: FloatArray, unseen_u: FloatArray, unseen_y: FloatArray) -> float:
    """Return the fit of a line through the commands on unseen samples [%]: the trivial model.

    Parameters
    ----------
    u, unseen_u : (N,) or (N, M) arrays
        Commands that the line goes through, and those that it is tested on [their units].
    y, unseen_y : (N,) arrays
        Outputs likewise [their units].
    """
    if float(np.ptp(u)) == 0.0:
        return float("nan")
    table, unseen = (
        np.column_stack([x.reshape(len(x), -1), np.ones(len(x))]) for x in (u, unseen_u)
    )
    line = np.linalg.lstsq(table, y, rcond=None)[0]
    return fit_percent(unseen_y, unseen @ line)
