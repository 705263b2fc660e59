# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Baselines that every physical model is compared with: a line through the command, and ARX."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import lfilter, lfiltic

from valve_twin.core.prediction import fit_percent

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

_ORDERS = (1, 2, 3)
_UNSTABLE = 1.0 - 1e-9  # greatest pole of a free run that does not run away


@dataclass(frozen=True, slots=True)
class Arx:
    """A linear difference equation.

    y[n] = level - sum a[i] y[n-i] + sum b[j] u[n-delay-j]

    Attributes
    ----------
    a : (P,) array
        Feedback, from y[n-1] on [1].
    b : (P,) array
        Of the delayed command [output/input].
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
        """Return the (N,) output to a command alone, begun from the first measured samples.

        Parameters
        ----------
        u, y : (N,) arrays
            Command and output [their units]; of y only the first samples are used.
        """
        order, n = len(self.a), len(u)
        late = np.concatenate([np.full(self.delay, u[0]), u])[:n]
        drive = lfilter(self.b, [1.0], late, zi=lfiltic(self.b, [1.0], [], [u[0]] * order))[0]
        backward = np.concatenate([[1.0], self.a])
        state = lfiltic([1.0], backward, y[:order][::-1])
        rest = lfilter([1.0], backward, drive[order:] + self.level, zi=state)[0]
        whole: FloatArray = np.concatenate([y[:order], rest])
        return whole


def fit_arx(u: FloatArray, y: FloatArray, delays: tuple[int, ...]) -> Arx | None:
    """Return the stable ARX model whose free run fits best where it was trained.

    Parameters
    ----------
    u, y : (N,) arrays
        Command and output [their units].
    delays : tuple of int
        Tried, with orders 1 to 3 [samples].

    Returns
    -------
    Arx or None
        None where none is stable.
    """
    best: tuple[float, Arx] | None = None
    for order, delay in itertools.product(_ORDERS, sorted(set(delays))):
        first = order + delay
        rows = len(y) - first
        if rows < 4 * order + 4:
            continue
        past = [-y[first - i : len(y) - i] for i in range(1, order + 1)]
        drive = [u[first - delay - j : len(u) - delay - j] for j in range(order)]
        table = np.column_stack([*past, *drive, np.ones(rows)])
        theta: FloatArray = np.linalg.lstsq(table, y[first:], rcond=None)[0].astype(np.float64)
        a = theta[:order]
        if np.abs(np.roots(np.concatenate([[1.0], a]))).max() > _UNSTABLE:
            continue
        made = Arx(a, theta[order : 2 * order], float(theta[-1]), delay)
        fit = fit_percent(y, made.free_run(u, y))
        if np.isfinite(fit) and (best is None or fit > best[0]):
            best = fit, made
    return None if best is None else best[1]


def line_fit(u: FloatArray, y: FloatArray, unseen_u: FloatArray, unseen_y: FloatArray) -> float:
    """Return the fit of a line through the command on unseen samples [%]: the trivial model.

    Parameters
    ----------
    u, y, unseen_u, unseen_y : (N,) arrays
        What the line goes through, and what it is tested on [their units].
    """
    if float(np.ptp(u)) == 0.0:
        return float("nan")
    gain, level = np.polyfit(u, y, 1)
    return fit_percent(unseen_y, gain * unseen_u + level)
