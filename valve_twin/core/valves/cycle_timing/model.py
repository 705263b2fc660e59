# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The timing of a fixed cycle: what is measured in each one and how the next is predicted."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.refusal import Refusal
from valve_twin.core.types import (
    Estimate,
    EstimateStatus,
    MaskCounts,
    ParameterStatus,
    ParameterValue,
)
from valve_twin.core.valves.cycle_timing.kernels import STATE_SIZE, predict_block
from valve_twin.core.valves.cycle_timing.parameters import (
    ESTIMATOR,
    PARAMETERS,
    STROKES,
    CycleTimingOptions,
)
from valve_twin.core.valves.cycle_timing.strokes import find_strokes
from valve_twin.core.valves.cycle_timing.timing import Timing, find_timing
from valve_twin.core.valves.cycle_timing.windows import windows_of
from valve_twin.core.valves.kit.compiled import CompiledModel
from valve_twin.core.valves.kit.outcome import Evidence, conclude

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.types import Cycle, FloatArray, Parameter


@dataclass(frozen=True, slots=True)
class CycleTimingModel(CompiledModel):
    """Implements `ValveModel` for a flow in a fixed cycle; no command is recorded."""

    name: str = "cycle_timing"
    inputs: tuple[str, ...] = ()
    output: str = "flow"
    parameters: tuple[Parameter, ...] = (*PARAMETERS, *STROKES)
    options: CycleTimingOptions = field(default_factory=CycleTimingOptions)
    kernel = predict_block
    state_size = STATE_SIZE
    trend_estimator: str = ESTIMATOR

    def estimate(
        self, cycle: Cycle, options: CycleTimingOptions, earlier: Sequence[Estimate] = ()
    ) -> tuple[Estimate, ...]:
        """Measure valve lag and pump leakage in one cycle.

        Parameters
        ----------
        cycle : Cycle
            One cycle of N samples.
        options : CycleTimingOptions
            The model's options.
        earlier : sequence of Estimate
            Not used: nothing is pooled.

        Returns
        -------
        tuple of Estimate
            One estimate; what the cycle does not show is REFUSED with its reason.
        """
        del earlier
        timing = find_timing(cycle, options)
        reasons = [r for r in (timing.spike_refusal, timing.steady_refusal) if r]
        status = (EstimateStatus.ACCEPTED, EstimateStatus.PARTIAL, EstimateStatus.REFUSED)[
            len(reasons)
        ]
        n = len(cycle.frames)
        bad = n - int(np.count_nonzero(cycle.frames.valid & np.isfinite(cycle.frames.position)))
        reason = Refusal(reasons[0].code, "; ".join(reasons)) if reasons else "accepted"
        evidence = Evidence(MaskCounts(timing.used, bad=bad), noise=timing.noise)
        values = _values(timing, options)
        if options.between_ends:
            values += _strokes(cycle, options)
        return (conclude(self.name, ESTIMATOR, cycle, values, (status, reason), evidence),)

    def coefficients(
        self, values: Mapping[str, float], lag: int, period_s: float, options: CycleTimingOptions
    ) -> FloatArray:
        """Return the (8,) coefficients, parameters as `ValveModel.coefficients`.

        NaN where a value is not known yet.
        """
        del lag
        nan = float("nan")
        return np.array(
            [
                values.get("rise_instant", nan) / period_s - 0.5,
                values.get("peak_flow", nan),
                values.get("steady_flow", nan),
                max(values.get("decay", nan) / period_s, 1e-6),
                options.spike_start_s / period_s,
                options.spike_end_s / period_s,
                options.steady_start_s / period_s,
                options.steady_end_s / period_s,
            ]
        )

    def also_followed(self, options: CycleTimingOptions) -> tuple[str, ...]:
        """Return dead time and stroke times between limit switches.

        Parameters
        ----------
        options : CycleTimingOptions
            The model's options.
        """
        return ("rise_instant", "decay", "close_time") if options.between_ends else ()

    def options_for(self, cycle: FloatArray, period_s: float) -> Mapping[str, object]:
        """Return where the mean cycle has its spike and steady part."""
        return windows_of(cycle, period_s)


def _values(timing: Timing, options: CycleTimingOptions) -> tuple[ParameterValue, ...]:
    """Return the values in the order of `PARAMETERS`."""
    spike, steady = timing.spike_refusal, timing.steady_refusal
    shown = (
        (timing.instant - options.healthy_instant_s, spike),
        (options.healthy_flow - timing.steady, steady),
        (timing.instant, spike),
        (timing.steady, steady),
        (timing.rise, spike),
        (timing.peak, spike),
        (timing.decay, spike or steady),
    )
    return tuple(
        ParameterValue(p.name, np.nan, ParameterStatus.REFUSED, reason)
        if reason
        else ParameterValue(p.name, value)
        for p, (value, reason) in zip(PARAMETERS, shown, strict=True)
    )


def _strokes(cycle: Cycle, options: CycleTimingOptions) -> tuple[ParameterValue, ...]:
    """Return the values in the order of `STROKES`."""
    found = find_strokes(cycle, options)
    reason = "the cycle does not show this"
    return tuple(
        ParameterValue(p.name, value)
        if np.isfinite(value)
        else ParameterValue(p.name, np.nan, ParameterStatus.REFUSED, reason)
        for p, value in zip(STROKES, (found.close_time, found.opened, found.closed), strict=True)
    )


MODEL = CycleTimingModel()
