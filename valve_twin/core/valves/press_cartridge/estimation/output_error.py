# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Output error of one cycle: pole, gains and leak of the valve from its free run.

The free run of the model is compared with the whole measured cycle, so position noise does not
bias it as it biases the equation error (equations.md 2.6). What the method rests on:

- delay and pole are searched (`timing`), the rest is an exact bounded least squares
  (`output_error_kernel`);
- the leak acts off the seats only, and the level of the run is unknown anew after each seat
  contact;
- repeated, stuck and bad samples have no weight: they are missing;
- both gains may fall with the command (pilot saturation); without that freedom the drift of the
  gain is biased by what the aging does to the commands;
- in motion the level may wander a little, so that a disturbance early in the cycle does not spoil
  all that follows.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from valve_twin.core.valves.press_cartridge.estimation.free_run import (
    OutputErrorOptions,
    fit_lag,
)
from valve_twin.core.valves.press_cartridge.estimation.gains import (
    GainFit,
    gain_fit,
    prepare_cycle,
    refused_fit,
)
from valve_twin.core.valves.press_cartridge.estimation.response.timing import (
    choose_timing,
    find_timing,
)

if TYPE_CHECKING:
    from valve_twin.core.estimation.data.masks import Masks
    from valve_twin.core.types import Frames
    from valve_twin.core.valves.press_cartridge.estimation.response.timing import Timing


def fit_output_error(
    frames: Frames,
    masks: Masks,
    period_s: float,
    *,
    noise_sigma: float = float("nan"),
    pooled: Timing | None = None,
    options: OutputErrorOptions | None = None,
) -> GainFit:
    """Fit pole, K_in, K_out(v) and leak to one cycle.

    Parameters
    ----------
    frames : Frames
        Samples of one cycle, inputs (inflow, outflow).
    masks : Masks
        Its masks.
    period_s : float
        Sampling time [s].
    noise_sigma : float
        Position noise at rest [1]; NaN = unknown.
    pooled : Timing, optional
        What other cycles of the valve say of its delay and pole.
    options : OutputErrorOptions, optional
        Limits and constraints.

    Returns
    -------
    GainFit
        Without standard errors: those from the residuals of a free run are far too narrow as soon
        as there is process noise (equations.md 2.6). The limits hold what is wrong in every cycle
        alike. A cycle that cannot be used is a value with its
        reason, never an exception.
    """
    options = options or OutputErrorOptions()
    prepared = prepare_cycle(frames, masks, period_s, noise_sigma, options)
    if isinstance(prepared, str):
        return refused_fit(prepared, masks)
    run, columns = prepared.run, prepared.columns
    alone = find_timing(run, prepared.lag, columns, options, prepared.phases)
    chosen = choose_timing(run, alone, pooled, columns, options)
    timing, phases = chosen.timing, chosen.phases
    timed = replace(options, pole=timing.pole)
    solution = fit_lag(run, phases, columns, timed, chosen.linear)
    return gain_fit(prepared, solution, phases, masks, options, timing=timing, alone=alone)
