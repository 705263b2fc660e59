# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The options of each part of the estimation, from those of the model.

Those of one valve are the same object in every cycle, so that what was made of the last is kept.
"""

from __future__ import annotations

from functools import wraps
from typing import TYPE_CHECKING, TypeVar

from valve_twin.core.estimation.data.masks import MaskOptions
from valve_twin.core.valves.press_cartridge.diagnosis import features
from valve_twin.core.valves.press_cartridge.estimation.constraints import parse_inequalities
from valve_twin.core.valves.press_cartridge.estimation.equation_error import EquationErrorOptions
from valve_twin.core.valves.press_cartridge.estimation.excitation import GuardOptions
from valve_twin.core.valves.press_cartridge.estimation.free_run import OutputErrorOptions

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.valves.press_cartridge.parameters import PressCartridgeOptions

T = TypeVar("T")


def _of_the_last(
    make: Callable[[PressCartridgeOptions], T],
) -> Callable[[PressCartridgeOptions], T]:
    """Keep what a function made of the last options that it was given; all are frozen."""
    last: list[tuple[PressCartridgeOptions | None, T | None]] = [(None, None)]

    @wraps(make)
    def made(options: PressCartridgeOptions) -> T:
        of, kept = last[0]  # both at once: another thread may ask for other options
        if of is options and kept is not None:
            return kept
        found = make(options)
        last[0] = options, found
        return found

    return made


@_of_the_last
def mask_options(options: PressCartridgeOptions) -> MaskOptions:
    """Return how samples are masked."""
    return MaskOptions(
        lower_stop=options.lower_seat,
        upper_stop=options.upper_seat,
        stop_margin=options.seat_margin,
        active_command=options.active_command,
        max_lag=options.max_lag,
    )


def feature_options(options: PressCartridgeOptions) -> features.FeatureOptions:
    """Return how features of faults are found."""
    lag = options.lag
    return features.FeatureOptions(
        lower_seat=options.lower_seat,
        upper_seat=options.upper_seat,
        margin=options.seat_margin,
        active_command=options.active_command,
        lag=lag if lag >= 0 else features.FeatureOptions().lag,
    )


@_of_the_last
def guard_options(options: PressCartridgeOptions) -> GuardOptions:
    """Return when a gain is refused."""
    return GuardOptions(active_command=options.active_command, min_travel=options.min_travel)


def output_error_options(options: PressCartridgeOptions, lag: int) -> OutputErrorOptions:
    """Return how the free run is fitted at a settled lag [samples]; negative = search."""
    return OutputErrorOptions(
        v_ref=options.v_ref,
        v_max=options.v_max,
        lag=lag,
        max_lag=options.max_lag,
        delay=float(options.lag),
        pole=options.pole_fixed,
        wander=options.wander,
        lower_seat=options.lower_seat,
        upper_seat=options.upper_seat,
        seat_margin=options.seat_margin,
        offset_in=options.v_offset_in,
        offset_out=options.v_offset_out,
        min_hold=options.min_hold,
        guard=guard_options(options),
    )


@_of_the_last
def equation_error_options(options: PressCartridgeOptions) -> EquationErrorOptions:
    """Return how the equation error is fitted."""
    return EquationErrorOptions(
        v_in_max=options.v_max,
        v_out_max=options.v_max,
        extended=options.extended_constraints,
        constraints=parse_inequalities(options.constraints) if options.constraints else None,
        solver=options.solver,
        guard=guard_options(options),
    )
