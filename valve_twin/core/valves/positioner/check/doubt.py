# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Put on an estimate of the plain law what other structures make of its cycle."""

from __future__ import annotations

from dataclasses import replace
from math import inf, isfinite
from typing import TYPE_CHECKING

from valve_twin.core.valves.positioner.check.rivals import MOVED

if TYPE_CHECKING:
    from valve_twin.core.types import Estimate, ParameterValue
    from valve_twin.core.valves.positioner.check.rivals import Rivals

_NOISE_MOST = 2.0  # what the best structure may leave, over the noise at rest [1], assumed
_TOLD = 0.02  # of a value, from which the reason names the structure [1], assumed
_REMEDY = {
    "velocity_lag": "the speed lags (second_order)",
    "stiction": "it sticks (max_stiction)",
    "backlash": "it has play (max_backlash)",
    "rest_level": "it settles beside its command (an offset, or static_curve)",
    "static_gain": "it settles at a part of its command (a scale, or static_curve)",
    "delay_falling": "a falling command has another delay (two_delays)",
    "part_of_a_sample": "it answers between two samples (sample faster)",
}


def doubted(estimate: Estimate, rivals: Rivals, noise: float) -> Estimate:
    """Return an estimate whose limits hold what other structures make of its parameters.

    Its intervals come from the scatter between cycles, which no wrong structure moves: where none
    of the structures follows the cycle there are no limits.

    Parameters
    ----------
    estimate : Estimate
        Of the plain law.
    rivals : Rivals
        What other structures make of the same cycle.
    noise : float
        Position noise at rest [1]; NaN where there is no rest.
    """
    lost = isfinite(noise) and rivals.left > _NOISE_MOST * max(noise, rivals.quantum)
    words = " and ".join(_REMEDY[t] for t in rivals.best.terms)
    half = dict(zip(MOVED, rivals.moved.tolist(), strict=True))
    changed = []
    for p in estimate.parameters:
        if p.name not in half or not p.usable:
            changed.append(p)
        elif lost:
            why = (
                f"no interval: no structure that was tried follows the cycle closer than "
                f"{rivals.left:.2g} of the stroke, the noise is {noise:.2g}"
            )
            changed.append(replace(p, reason=why, lower_95=-inf, upper_95=inf))
        else:
            changed.append(_wider(p, half[p.name], words))
    return replace(estimate, parameters=tuple(changed))


def _wider(p: ParameterValue, moved: float, words: str) -> ParameterValue:
    """Return a value with what the structure may have done to it, its scatter comes later."""
    told = bool(words) and moved > _TOLD * abs(p.value)
    reason = f"wider by {moved:.2g}: the free run follows better if {words}" if told else p.reason
    return replace(p, reason=reason, lower_95=p.value - moved, upper_95=p.value + moved)
