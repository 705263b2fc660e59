# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The recursive adaptation of a stepper valve against recursive least squares of a library."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.bench.measure import Ratio, Scale, median
from valve_twin.core.estimation.recursive import Adaptation, Structure, identify

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from valve_twin.core.types import FloatArray

SAMPLES = 2000
_GAIN = 100.0
_TRUTH = np.array([-1.5, 0.7, 0.12, 0.06])
_STRUCTURE = Structure(na=2, nb=2)


def compare(scale: Scale) -> Iterator[Ratio]:
    """Yield the comparison: 4 parameters, one pass over 2000 samples, the same estimate."""
    y, u = _record()
    how = Adaptation(initial_gain=_GAIN)
    rows = np.column_stack([-y[1:-1], -y[:-2], u[1:-1], u[:-2]])
    ours = identify(_STRUCTURE, y, u, adaptation=how, corrected=False).state.theta
    if not np.allclose(ours, learn_in_numpy(rows, y[2:]), rtol=0.0, atol=1e-6):
        msg = f"the parameters differ: ours {ours!r}"
        raise AssertionError(msg)
    name, peer = _peer(rows, y[2:])
    yield Ratio(
        f"recursive adaptation of {SAMPLES} samples",
        name,
        median(lambda: identify(_STRUCTURE, y, u, adaptation=how, corrected=False), scale.repeats),
        median(peer, scale.repeats),
        2.0,
    )


def learn_in_numpy(rows: FloatArray, outputs: FloatArray) -> FloatArray:
    """Return the parameters (4,) after N rows (N, 4), by the update that padasip writes."""
    theta, f = np.zeros(rows.shape[1]), _GAIN * np.eye(rows.shape[1])
    for phi, output in zip(rows, outputs, strict=True):
        error = output - np.dot(theta, phi)
        first = np.dot(np.dot(np.dot(f, phi[:, None]), phi[None, :]), f)
        f = f - first / (1.0 + np.dot(np.dot(phi, f), phi))
        theta = theta + np.dot(f, phi) * error
    return theta


def _peer(rows: FloatArray, outputs: FloatArray) -> tuple[str, Callable[[], object]]:
    """Return padasip where it is installed, else its update in numpy."""
    try:
        filters = import_module("padasip.filters")
    except ImportError:
        return "numpy, as padasip writes it", lambda: learn_in_numpy(rows, outputs)
    return "padasip", lambda: filters.FilterRLS(n=4, mu=1.0, eps=1.0 / _GAIN).run(outputs, rows)


def _record() -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(12)
    u = rng.uniform(-1.0, 1.0, SAMPLES)
    y = np.zeros(SAMPLES)
    for n in range(2, SAMPLES):
        y[n] = _TRUTH @ np.array([-y[n - 1], -y[n - 2], u[n - 1], u[n - 2]])
    return y + 0.02 * rng.standard_normal(SAMPLES), u
