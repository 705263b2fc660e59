# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The recursive adaptation of a stepper valve against recursive least squares of a library."""

from __future__ import annotations

from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.bench.measure import Ratio, Scale, median
from valve_twin.core.estimation.recursive.estimator import (
    Adaptation,
    Structure,
    adapt,
    identify,
    start,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from valve_twin.core.types import FloatArray

SAMPLES = 2000
GAIN = 100.0
_TRUTH = np.array([-1.5, 0.7, 0.12, 0.06])
_HOW = Adaptation(initial_gain=GAIN)


def compare(scale: Scale) -> Iterator[Ratio]:
    """Yield the comparisons: 4 and 6 parameters, one pass over 2000 samples, the same estimate.

    The last one calls both sample by sample, as a controller does.
    """
    y, u = record()
    learn, name = peer()
    for order, what in ((2, ""), (3, ", 6 parameters")):
        structure = Structure(na=order, nb=order)
        rows, outputs = regression(y, u, order)
        require_same(identified(structure, y, u), learn(rows, outputs), name)
        yield Ratio(
            f"recursive adaptation of {SAMPLES} samples{what}",
            name,
            median(partial(identified, structure, y, u), scale.repeats),
            median(partial(learn, rows, outputs), scale.repeats),
            2.0,
        )
    structure = Structure(na=2, nb=2)
    rows, outputs = regression(y, u, 2)
    require_same(stepped(structure, y, u), learn(rows, outputs), name)
    yield Ratio(
        f"recursive adaptation of {SAMPLES} samples, one call each",
        name,
        median(partial(stepped, structure, y, u), scale.repeats),
        median(partial(learn, rows, outputs), scale.repeats),
        2.0,
    )


def identified(structure: Structure, y: FloatArray, u: FloatArray) -> FloatArray:
    """Return our parameters (P,) after a record of outputs and inputs (N,).

    Parameters
    ----------
    structure : Structure
        Orders of the model.
    y, u : (N,) arrays
        Output and input [1].
    """
    found = identify(structure, y, u, adaptation=_HOW, corrected=False)
    return found.state.theta


def stepped(structure: Structure, y: FloatArray, u: FloatArray) -> FloatArray:
    """Return the same, one call a sample.

    Parameters
    ----------
    structure : Structure
        Orders of the model.
    y, u : (N,) arrays
        Output and input [1].
    """
    state = start(structure, _HOW)
    for n in range(len(y)):
        state = adapt(structure, _HOW, state, y[n : n + 1], u[n : n + 1]).state
    return state.theta


def regression(y: FloatArray, u: FloatArray, order: int) -> tuple[FloatArray, FloatArray]:
    """Return the rows (M, 2 order) of past outputs and inputs, and the outputs (M,).

    Parameters
    ----------
    y, u : (N,) arrays
        Output and input [1].
    order : int
        Past samples of each [1].
    """
    lags = range(1, order + 1)
    columns = [-y[order - k : len(y) - k] for k in lags] + [u[order - k : -k] for k in lags]
    return np.column_stack(columns), y[order:]


def require_same(ours: FloatArray, theirs: FloatArray, whom: str) -> None:
    """Refuse to compare the times of different parameters.

    Parameters
    ----------
    ours, theirs : (P,) arrays
        Parameters [1].
    whom : str
        Whose the others are.
    """
    if not np.allclose(ours, theirs, rtol=0.0, atol=1e-6):
        msg = f"the parameters differ: ours {ours!r}, {whom} {theirs!r}"
        raise AssertionError(msg)


def learn_in_numpy(rows: FloatArray, outputs: FloatArray) -> FloatArray:
    """Return the parameters (P,) after N rows (N, P), by the update that padasip writes."""
    theta, f = np.zeros(rows.shape[1]), GAIN * np.eye(rows.shape[1])
    for phi, output in zip(rows, outputs, strict=True):
        error = output - np.dot(theta, phi)
        first = np.dot(np.dot(np.dot(f, phi[:, None]), phi[None, :]), f)
        f = f - first / (1.0 + np.dot(np.dot(phi, f), phi))
        theta = theta + np.dot(f, phi) * error
    return theta


def peer() -> tuple[Callable[[FloatArray, FloatArray], FloatArray], str]:
    """Return padasip's filter and its name where it is installed, else its update in numpy."""
    try:
        filters = import_module("padasip.filters")
    except ImportError:
        return learn_in_numpy, "numpy, as padasip writes it"

    def learn(rows: FloatArray, outputs: FloatArray) -> FloatArray:
        rls = filters.FilterRLS(n=rows.shape[1], mu=1.0, eps=1.0 / GAIN, w="zeros")
        rls.run(outputs, rows)
        return np.array(rls.w)

    return learn, "padasip"


def record() -> tuple[FloatArray, FloatArray]:
    """Return outputs (N,) of a known system with noise, and its inputs (N,)."""
    rng = np.random.default_rng(12)
    u = rng.uniform(-1.0, 1.0, SAMPLES)
    y = np.zeros(SAMPLES)
    for n in range(2, SAMPLES):
        y[n] = _TRUTH @ np.array([-y[n - 1], -y[n - 2], u[n - 1], u[n - 2]])
    return y + 0.02 * rng.standard_normal(SAMPLES), u
