# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Tell whether the signals of a cycle can be those of a press valve.

Nearly every cycle passes all checks, which one compiled pass tells; where it does not, the checks
are made one by one, and the first that finds something says what.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.cycle.lag_kernels import (
    effects_at_lag,
    equals,
    explained_by_lag,
    steps_within,
    varies,
)
from valve_twin.core.estimation.cycle.plausibility import (
    EXPLAINED,
    FEWEST_STEPS,
    LARGEST,
    SURE,
    drive_fault,
    known_rows,
    same_fault,
    still_fault,
    unit_fault,
)
from valve_twin.core.estimation.data.masks import contiguous
from valve_twin.core.valves.press_cartridge.estimation.response.checks import (
    CLEAR,
    COARSEST,
    WORSE,
    lags_tried,
    late_fault,
    lost_fault,
    step_fault,
    stroke_fault,
)
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, Cycle, FloatArray
    from valve_twin.core.valves.press_cartridge.parameters import PressCartridgeOptions


def signal_fault(
    output: str, inputs: tuple[str, ...], cycle: Cycle, options: PressCartridgeOptions
) -> str:
    """Return why the signals cannot be those of a press valve, empty where they can.

    Parameters
    ----------
    output : str
        Name of the position.
    inputs : tuple of str
        Names of the command that raises it and of the one that lowers it.
    cycle : Cycle
        At least one sample.
    options : PressCartridgeOptions
        The model's options.
    """
    seats, frames, max_lag = (
        (options.lower_seat, options.upper_seat),
        cycle.frames,
        options.max_lag,
    )
    span = seats[1] - seats[0]
    reach = (LARGEST - 1.0) * span
    position_range = (seats[0] - reach, seats[1] + reach)
    if not options.usual_stroke > 0.0 and _passes(
        contiguous(frames.position),
        contiguous(frames.inputs),
        frames.valid,
        position_range,
        COARSEST * span,
        max_lag,
        lags_tried(len(frames), cycle.period_s, max_lag),
    ):
        return ""
    known = known_rows(frames)
    if len(known) == 0:
        return ""
    names, columns = (output, *inputs), (known.position, *known.inputs.T)
    faults = [
        unit_fault(name, u, LARGEST - 2.0, LARGEST)
        for name, u in zip(inputs, columns[1:], strict=True)
    ]
    # limits of a signal take out what would show its unit
    whole, seen = known is frames, frames.position
    seen = seen if whole else seen[np.isfinite(seen)]
    faults.append(unit_fault(output, seen, *position_range))
    y, period_s = known.position, cycle.period_s
    faults.append("" if whole else lost_fault(names, frames))
    faults.append(step_fault(output, y, span))
    faults.append(stroke_fault(output, y, options.usual_stroke))
    faults.append(same_fault(names, columns) or still_fault(inputs, columns[1:]))
    faults.append(drive_fault(names, y, known.inputs, seats=seats, max_lag=max_lag))
    faults.append(late_fault(output, y, known.inputs, period_s=period_s, max_lag=max_lag))
    return next((fault for fault in faults if fault), "")


@njit(cache=True)
def _passes(
    position: FloatArray,
    inputs: FloatArray,
    valid: BoolArray,
    position_range: tuple[float, float],
    coarsest: float,
    max_lag: int,
    reach: int,
) -> bool:
    """Return whether every check of `signal_fault` finds nothing; False = they are to be made."""
    if len(position) == 0 or not _in_range(position, inputs, valid, position_range):
        return False
    inflow, outflow = inputs[:, 0], inputs[:, 1]
    if equals(inflow, position) or equals(outflow, position) or equals(outflow, inflow):
        return False
    if not (steps_within(position, coarsest) and (varies(inflow) or varies(outflow))):
        return False
    driven, lag = False, 0
    while not driven and lag <= max_lag and len(position) - 1 - lag >= FEWEST_STEPS:
        explained, rising, falling = effects_at_lag(position, inputs, lag)
        driven = explained > EXPLAINED and rising > SURE and falling < -SURE
        lag += 1
    if not driven or reach <= max_lag:
        return driven
    agreement = explained_by_lag(position, inputs, reach)
    best = agreement.max()
    allowed = agreement[reach : reach + max_lag + 1].max()
    return bool(not best > CLEAR or allowed >= WORSE * best)


@njit(cache=True)
def _in_range(
    position: FloatArray,
    inputs: FloatArray,
    valid: BoolArray,
    position_range: tuple[float, float],
) -> bool:
    """Return whether all samples are valid, and all values inside what a normalised one can be."""
    for i in range(len(position)):
        # what is no number is inside no range
        if not (valid[i] and position_range[0] <= position[i] <= position_range[1]):
            return False
        for j in range(inputs.shape[1]):
            if not LARGEST - 2.0 <= inputs[i, j] <= LARGEST:
                return False
    return True
