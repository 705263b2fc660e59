# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the press cartridge valve publishes, and its options."""

from __future__ import annotations

from dataclasses import dataclass, field

from valve_twin.core.diagnosis.features import ESTIMATOR as SHOWN
from valve_twin.core.quantity import assumed, quantity, setting
from valve_twin.core.types import Parameter
from valve_twin.core.valves.interface import ModelOptions
from valve_twin.core.valves.kit.tolerances import tolerance_section
from valve_twin.core.valves.press_cartridge.diagnosis.features import COUNTS, FEATURES
from valve_twin.core.valves.press_cartridge.estimators import EQUATION_ERROR, KALMAN, OUTPUT_ERROR
from valve_twin.core.valves.press_cartridge.predictor import MAX_LAG

_GAIN = "1/sample of stroke per unit command"

PARAMETERS = (
    Parameter(
        "pole", "1", "pole of the spool speed, z = 1 + theta_1 (paper 002, eq. (17))", 0.0, 1.0
    ),
    Parameter(
        "K_in",
        "1",
        f"steady inflow gain theta_2/(-theta_1) at v_in_mean, {_GAIN}",
        0.0,
        trend=True,
        fall=("K_in_slope", "v_in_mean"),
        sided=("K", "in"),
    ),
    Parameter(
        "K_in_slope",
        "1",
        "change of the inflow gain with the command (pilot saturation)",
        upper=0.0,
    ),
    Parameter(
        "v_in_mean", "1", "displacement-weighted mean inflow command of the cycle", 0.0, 1.0
    ),
    Parameter(
        "K_out",
        "1",
        f"steady outflow gain -(theta_3 + theta_5 v)/(-theta_1) at v_ref, {_GAIN}",
        0.0,
        trend=True,
        fall=("K_out_slope",),
        sided=("K", "out"),
    ),
    Parameter(
        "K_out_slope",
        "1",
        "change of the outflow gain with the command, theta_5/theta_1",
        upper=0.0,
    ),
    Parameter("leak", "1/s", "loss of stroke off the seat", 0.0, trend=True),
    Parameter(
        "delay", "1", "command to position delay beside the pole, parts of a sample included", 0.0
    ),
    Parameter("delay_alone", "1", "delay that this cycle shows by itself, in samples", 0.0),
    Parameter("pole_alone", "1", "pole that this cycle shows by itself", 0.0, 1.0),
    Parameter(
        "noise_ratio", "1", "kalman: variance of process noise over that of measurement noise", 0.0
    ),
    Parameter("theta_1", "1", "paper 002, eq. (18): speed"),
    Parameter("theta_2", "1", "paper 002, eq. (18): inflow command"),
    Parameter("theta_3", "1", "paper 002, eq. (18): outflow command"),
    Parameter("theta_4", "1", "paper 002, eq. (18): inflow command squared"),
    Parameter("theta_5", "1", "paper 002, eq. (18): outflow command squared"),
    Parameter("theta_6", "1", "paper 002, eq. (18): product of the commands"),
    Parameter("theta_7", "1", "paper 002, eq. (18): inflow command times speed"),
    Parameter("theta_8", "1", "paper 002, eq. (18): outflow command times speed"),
    *FEATURES,
    *COUNTS,
)


@dataclass(frozen=True, slots=True)
class PressCartridgeNumbers:
    """Known constants of the valve."""

    lower_seat: float = quantity(0.0, "1", "position on the lower seat", lower=-1.0, upper=2.0)
    upper_seat: float = quantity(1.0, "1", "position on the upper seat", lower=-1.0, upper=2.0)
    v_offset_in: float = quantity(
        0.0, "1", "inflow command below which the pilots stay shut", lower=0.0, upper=0.5
    )
    v_offset_out: float = quantity(
        0.0, "1", "outflow command below which the pilots stay shut", lower=0.0, upper=0.5
    )


PressCartridgeTolerances = tolerance_section(
    "PressCartridgeTolerances",
    __name__,
    PressCartridgeNumbers,
    dict.fromkeys(("lower_seat", "upper_seat", "v_offset_in", "v_offset_out"), 0.0),
    absolute=True,
)


@dataclass(frozen=True, slots=True)
class PressCartridgeOptions(PressCartridgeNumbers, ModelOptions):
    """Options of the model."""

    estimators: tuple[str, ...] = setting(
        (OUTPUT_ERROR, KALMAN, "equation_error_qp4"),
        "estimators to run",
        choices=(OUTPUT_ERROR, KALMAN, *EQUATION_ERROR, SHOWN),
    )
    output_error: bool = setting(
        True,
        "run the output error in every cycle, which trend and prediction need; "
        "false = only the estimators listed, each cycle by itself, without test "
        "errors and intervals: to re-estimate an archive by constrained least "
        "squares",
    )
    v_ref: float = assumed(0.3, "1", "outflow command at which K_out is published", 0.0, 1.0)
    v_max: float = assumed(0.8, "1", "greatest command: gains are positive up to it", 0.01, 1.0)
    lag: int = quantity(
        -1,
        "samples",
        "command to position lag, -1 = search in each cycle",
        lower=-1,
        upper=MAX_LAG,
    )
    max_lag: int = quantity(4, "samples", "longest lag tried", lower=0, upper=MAX_LAG)
    pole_fixed: float = quantity(
        -1.0, "1", "pole of the output error, -1 = search", lower=-1.0, upper=0.98
    )
    wander: float = assumed(
        0.03,
        "1",
        "random walk of the level in motion, variance a sample over noise variance",
        0.0,
        1e6,
    )
    usual_stroke: float = quantity(
        0.0,
        "1",
        "stroke of a usual cycle, 0 = not known: a cycle of less than 0.6 or more than 1.6 of it "
        "is refused, which a wrong scale of the position needs to be seen",
        lower=0.0,
        upper=2.0,
    )
    seat_margin: float = assumed(0.01, "1", "distance from a seat that counts as on it", 0.0, 0.2)
    active_command: float = assumed(0.01, "1", "command above which an input acts", 0.0, 0.5)
    min_travel: float = assumed(2e-3, "1", "least travel that tells a gain", 0.0, 1.0)
    min_hold: int = assumed(
        30, "samples", "fewest samples of hold off the seat that tell a leak", lower=1
    )
    extended_constraints: bool = setting(
        True,
        "equation error: also pole and monotone flows at every command, which the paper lacks",
    )
    constraints: tuple[str, ...] = setting(
        (), 'equation error: further linear inequalities, e.g. "theta_2 + 0.3*theta_3 <= 0"'
    )
    solver: str = setting("exact", "solver of the equation error", choices=("exact", "cvxpy"))
    tolerances: object = field(default_factory=PressCartridgeTolerances)
