# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is checked of a fit of gains, each as a value with a reason, whether it passed or not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.types import Guard, ParameterStatus

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.estimation.solvers.identifiability import Identifiability
    from valve_twin.core.types import ParameterValue
    from valve_twin.core.valves.press_cartridge.estimation.excitation import (
        Excitation,
        GuardOptions,
    )


def check_noise(sigma: float, options: GuardOptions) -> Guard:
    """Check the position noise measured at rest.

    Parameters
    ----------
    sigma : float
        Standard deviation at rest [1]; NaN where the cycle has no rest.
    options : GuardOptions
        Limits.
    """
    limit = options.max_noise
    if not np.isfinite(sigma):
        return Guard("noise at rest", False, np.nan, limit, "the cycle has no rest to measure it")
    reason = f"{sigma:.2g} of the stroke"
    return Guard("noise at rest", bool(sigma <= limit), float(sigma), limit, reason)


def check_excitation(
    inflow: Excitation, outflow: Excitation, options: GuardOptions
) -> tuple[Guard, ...]:
    """Check what each direction and its command levels excite.

    Parameters
    ----------
    inflow, outflow : Excitation
        What each command did.
    options : GuardOptions
        Limits.
    """
    found = []
    for name, of in (("inflow", inflow), ("outflow", outflow)):
        moved = of.reason if not of.excited else f"travel {of.travel:.2g} in {of.samples} rows"
        excited, graded = bool(of.excited), bool(of.graded)
        found.append(Guard(f"excitation of {name}", excited, of.travel, of.needed, moved))
        spread = f"the levels spread by {of.level_spread:.0%}"
        if excited and not graded:
            spread = f"{of.reason}: the gain is that at {of.level:.2g}"
        elif not excited:
            spread = of.reason
        limit = options.min_level_spread
        found.append(Guard(f"levels of {name}", graded, of.level_spread, limit, spread))
    return tuple(found)


def check_condition(condition_number: float, options: GuardOptions) -> Guard:
    """Check the condition number after column scaling.

    Parameters
    ----------
    condition_number : float
        Of the column-scaled sensitivities [1].
    options : GuardOptions
        Limits.
    """
    passed = bool(condition_number <= options.max_condition)
    reason = f"{condition_number:.3g} of the column-scaled sensitivities"
    return Guard("condition number", passed, condition_number, options.max_condition, reason)


def check_bounds(parameters: Sequence[ParameterValue], followed: Sequence[str]) -> Guard:
    """Check that no followed parameter rests on a bound.

    Parameters
    ----------
    parameters : sequence of ParameterValue
        As published.
    followed : sequence of str
        Those that the trend follows.
    """
    on = [p.name for p in parameters if p.status is ParameterStatus.AT_BOUND]
    bad = [name for name in on if name in followed]
    reason = f"on a bound: {', '.join(on)}" if on else "no parameter rests on a bound"
    return Guard("bounds", not bad, float(len(bad)), 0.0, reason)


def check_identifiability(found: Identifiability, max_error: float) -> Guard:
    """Check that each parameter is determined singly.

    Parameters
    ----------
    found : Identifiability
        What was found.
    max_error : float
        Largest relative error [1].
    """
    worst = float(np.max(found.errors, initial=0.0))
    reason = found.reason or f"largest standard error {worst:.1%} of the parameter's size"
    return Guard("identifiability", not found.reason, worst, max_error, reason)


def check_gap(
    own: Mapping[str, float], theta: Mapping[str, float], v_ref: float, options: GuardOptions
) -> tuple[Guard, ...]:
    """Check the gains against those of an equation-error fit of the same cycle.

    Parameters
    ----------
    own : mapping
        Values by name: `K_in` at `v_in_mean`, `K_out` at `v_ref`; NaN where not known.
    theta : mapping
        theta_1 ... theta_8 of paper 002 as far as they were fitted; NaN where not known.
    v_ref : float
        Outflow command at which K_out is published [1].
    options : GuardOptions
        Limits.
    """

    def term(number: int) -> float:
        value = theta.get(f"theta_{number}", 0.0)
        return value if np.isfinite(value) or number in (1, 2, 3) else 0.0

    speed, v_mean = -term(1), own.get("v_in_mean", np.nan)
    if not speed > 0.0:
        return ()
    gain_in, gain_out = (own.get(name) or np.nan for name in ("K_in", "K_out"))  # 0 = none
    gaps = {
        "K_in": (term(2) + term(4) * v_mean) / speed / gain_in - 1.0,
        "K_out": -(term(3) + term(5) * v_ref) / speed / gain_out - 1.0,
        "pole": 1.0 - speed - own.get("pole", np.nan),
    }
    found = []
    for name, gap in gaps.items():
        if not np.isfinite(gap):
            continue
        limit = options.max_pole_gap if name == "pole" else options.max_gap
        apart = f"{gap:+.2f}" if name == "pole" else f"{100.0 * gap:+.1f} %"
        title = f"equation-error gap of {name}"
        reason = f"{name} by equation error differs by {apart}"
        found.append(Guard(title, bool(abs(gap) <= limit), float(gap), limit, reason))
    return tuple(found)
