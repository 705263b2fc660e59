# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which gains, slopes, leak and pole a fit determines singly."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.solvers.identifiability import (
    Identifiability,
    IdentifiabilityOptions,
    assess_identifiability,
    information_root,
)
from valve_twin.core.types import ParameterStatus, ParameterValue
from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import N_LINEAR

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray, IntArray
    from valve_twin.core.valves.press_cartridge.estimation.free_run import (
        OutputErrorOptions,
        Solution,
    )

RIDGE = IdentifiabilityOptions()
"""When a parameter counts as lost."""

_LEAK_SHARE = 0.05  # of the speed at the greatest command


def gain_identifiability(
    s: Solution, fitted: IntArray, mse: float, period_s: float, options: OutputErrorOptions
) -> Identifiability:
    """Tell which of the published parameters are known singly.

    The sizes say when a parameter is lost altogether, not when it is precise: a slope that takes
    the whole gain away over the commands, a leak of a twentieth of the greatest speed, a pole of
    1.

    Parameters
    ----------
    s : Solution
        The fit.
    fitted : (F,) int64 array
        Columns that are not on a bound, the pole with them.
    mse : float
        Mean squared weighted residual [1].
    period_s : float
        Sampling time [s].
    options : OutputErrorOptions
        Where the gains are published.
    """
    names: list[str] = []
    rows: list[FloatArray] = []  # published parameters as combinations of the fitted ones
    sizes: list[float] = []
    speed = 0.0
    unit = np.eye(N_LINEAR + 1)[:, fitted]
    for first, name, command in ((0, "K_in", s.v_in_mean), (2, "K_out", options.v_ref)):
        weight = 2.0 * options.v_max - (command if np.isfinite(command) else 0.0)
        gain = unit[first] + weight * unit[first + 1]
        if not gain.any():
            continue
        value = float(s.linear[first] + weight * s.linear[first + 1])
        names.append(name)
        rows.append(gain)
        sizes.append(value)
        speed = max(speed, value * options.v_max)
        if unit[first].any() and unit[first + 1].any():
            names.append(f"{name}_slope")
            rows.append(-unit[first + 1])
            sizes.append(value / options.v_max)
    leak = max(float(s.linear[4]), _LEAK_SHARE * speed)
    for k, name, size in ((4, "leak", leak), (5, "pole", 1.0)):
        if unit[k].any():
            names.append(name)
            rows.append(unit[k] / period_s if name == "leak" else unit[k])
            sizes.append(size / period_s if name == "leak" else size)
    root = information_root(s.gram[np.ix_(fitted, fitted)])
    matrix = np.linalg.inv(np.array(rows)) if rows else np.zeros((0, 0))
    values = np.linalg.solve(matrix, np.append(s.linear, s.pole)[fitted]) if rows else np.zeros(0)
    return assess_identifiability(
        names,
        values,
        root @ matrix,
        float(np.sqrt(max(mse, 0.0))),
        sizes=np.array(sizes),
        options=RIDGE,
    )


def refuse_ridges(
    parameters: tuple[ParameterValue, ...], found: Identifiability
) -> tuple[ParameterValue, ...]:
    """Refuse what lies on a ridge; what is merely weak has its own reason already.

    Parameters
    ----------
    parameters : tuple of ParameterValue
        As published.
    found : Identifiability
        What was found of them.
    """
    on = {name for ridge in found.ridges for name in ridge}
    return tuple(
        ParameterValue(p.name, float("nan"), ParameterStatus.REFUSED, found.reason)
        if p.name in on
        else p
        for p in parameters
    )
