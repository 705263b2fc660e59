# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What may be wrong with a parameter in every cycle alike: no scatter between cycles shows it.

Four causes are left after delay and pole are fitted, each derived from the fit itself:

- timing: a response is not the pole's inside a sample, and the logger sees one of several commands
  of a controller. What that may do to a gain is its sensitivity to the time of the response, and
  how little the cycle knows that time once the edges of jumping commands are left out (`unseen`);
- curvature: the gain is a line of the command in the model and a curve in the valve. A line of
  relative fall S over the commands lies up to S^2/8 off a parabola, and more off a root;
- tails: what is left of a motion when hold begins passes for leak, beside its own sensitivity to
  the time of the response;
- steps: a sensor that moves in steps shows a leak to a step in a hold (`unseen`).

The sizes of the constants come from 200 random plants at noise 1e-5.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.cycle.scatter import scatter_between_cycles
from valve_twin.core.estimation.data.robust import NORMAL_975
from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import N_LINEAR
from valve_twin.core.valves.press_cartridge.estimation.response.unseen import (
    step_leak,
    timing_spread,
)
from valve_twin.core.valves.press_cartridge.estimation.whitened.inverse import inverse_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.types import Estimate, FloatArray, ParameterValue
    from valve_twin.core.valves.press_cartridge.estimation.free_run import (
        OutputErrorOptions,
        Phases,
        Run,
        Solution,
    )
    from valve_twin.core.valves.press_cartridge.estimation.response.timing import Timing

_LATE = 0.13
"""Half width of the 95 % interval of what the time of a response may be wrong [samples]."""

_LATE_FIXED = 0.3
"""The same where the delay is configured in whole samples [samples], assumed."""

_CURVED = 0.2
"""Half width of the 95 % interval of the curvature, in units of the squared relative fall [1]."""

_LEAST_GAIN = 0.002
"""Half width of the 95 % interval of what else moves a gain, relative to it [1]."""

_TAIL = 0.004
"""Half width of the 95 % interval of what tails of motion do to the leak, relative to it [1]."""

_FALLS = ("K_in_slope", "K_out_slope")
"""What is not above 0; what else has errors is not below."""


def systematic_halves(
    s: Solution,
    run: Run,
    phases: Phases,
    timing: Timing,
    options: OutputErrorOptions,
    own: FloatArray | None = None,
) -> dict[str, float]:
    """Return the half width of the 95 % interval of what is wrong in every cycle alike.

    Parameters
    ----------
    s : Solution
        The fit, gains [1/sample of stroke per unit command].
    run : Run
        The cycle.
    phases : Phases
        What the spool does at each sample, by the delay of `timing`.
    timing : Timing
        When commands act.
    options : OutputErrorOptions
        Where the gains are published.
    own : (5,) array, optional
        Linear parameters of the output error at that timing [1]; fitted where omitted.

    Returns
    -------
    dict
        Of K_in, K_out and leak, each in its unit, as far as they were fitted.
    """
    moves = _by_time(s)
    late, spread = _LATE_FIXED, np.zeros((N_LINEAR, N_LINEAR))
    if options.delay < 0.0:
        late = _LATE
        spread = NORMAL_975**2 * timing_spread(run, phases, timing, s.columns, options, own)
    steps = step_leak(run, phases)
    tail = (late * moves[4]) ** 2 + (_TAIL * s.linear[4]) ** 2 + spread[4, 4] + steps**2
    found = {"leak": float(np.sqrt(tail)) / run.period_s}
    for name, first, command in (("K_in", 0, s.v_in_mean), ("K_out", 2, options.v_ref)):
        weight = 2.0 * options.v_max - command
        value = float(s.linear[first] + weight * s.linear[first + 1])
        if not value > 0.0:
            continue
        at = np.zeros(N_LINEAR)
        at[first : first + 2] = 1.0, weight
        time = float((late * (at @ moves)) ** 2 + at @ spread @ at)
        fall = options.v_max * float(s.linear[first + 1]) / value
        curvature = _CURVED * fall**2 * value
        found[name] = float(np.sqrt(time + curvature**2 + (_LEAST_GAIN * value) ** 2))
    return found


def with_limits(
    parameters: tuple[ParameterValue, ...],
    errors: Mapping[str, float],
    systematic: Mapping[str, float],
    scatter: Mapping[str, float] | None = None,
) -> tuple[ParameterValue, ...]:
    """Add standard errors, and 95 % limits of both kinds of error together.

    Parameters
    ----------
    parameters : tuple of ParameterValue
        Values of the cycle.
    errors : mapping
        Standard errors by name; empty where the scatter comes from other cycles: the limits are
        then those of what is wrong in every cycle alike. A value on its bound has none then: its
        scatter is cut off there.
    systematic : mapping
        As `systematic_halves` returns it.
    scatter : mapping, optional
        As `scatter_halves` returns it: where cycles scatter by more than a cycle's own error says,
        the limits hold the scatter.
    """
    scattered = scatter or {}
    found = []
    for p in parameters:
        error = errors.get(p.name, np.nan)
        known = np.isfinite(error) if errors else p.name in systematic and p.usable
        if not (known and np.isfinite(p.value)):
            found.append(p)
            continue
        own = max(NORMAL_975 * error, scattered.get(p.name, 0.0)) if errors else 0.0
        half = float(np.hypot(own, systematic.get(p.name, 0.0)))
        lower, upper = p.value - half, p.value + half
        if p.name in _FALLS:
            upper = min(upper, 0.0)
        elif errors:
            lower = max(lower, 0.0)
        found.append(replace(p, standard_error=error, lower_95=lower, upper_95=upper))
    return tuple(found)


def scatter_halves(earlier: Sequence[Estimate]) -> dict[str, float]:
    """Return half the 95 % interval of the scatter between cycles, where there are enough.

    Parameters
    ----------
    earlier : sequence of Estimate
        Estimates of one estimator, oldest first.

    Returns
    -------
    dict
        Of K_in, K_out and leak, each in its unit.
    """
    found = {}
    for name in ("K_in", "K_out", "leak"):
        series = [p.value for e in earlier for p in e.parameters if p.name == name and p.usable]
        half = scatter_between_cycles(np.array(series)).half_width_95
        if np.isfinite(half):
            found[name] = half
    return found


def _by_time(s: Solution) -> FloatArray:
    """Return how the linear parameters move if the response is a sample later: (5,)."""
    moves = np.zeros(N_LINEAR)
    fitted = np.flatnonzero((s.linear > 0.0) & (np.diag(s.gram)[:N_LINEAR] > 0.0))
    if len(fitted):
        moves[fitted] = -(inverse_of(s.gram, fitted) @ s.gram[fitted, N_LINEAR])
    return moves * (1.0 - s.pole) ** 2
