# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the stepper valve publishes, and its options."""

from __future__ import annotations

from dataclasses import dataclass, field

from valve_twin.core.diagnosis.features import ESTIMATOR as FEATURES
from valve_twin.core.quantity import assumed, quantity, setting
from valve_twin.core.types import Parameter
from valve_twin.core.valves.interface import ModelOptions
from valve_twin.core.valves.kit.tolerances import tolerance_section
from valve_twin.core.valves.stepper_servo.predictor import MAX_LAG, ORDER

MECHANICS = "backlash_output_error"
WIENER = "recursive_hammerstein_wiener"

EDGE = 1e-4
"""What the corners of the sensor's average and of the flow meter leave of an edge, in parts of the
stroke; measured on the simulated valve (docs/valves/stepper_servo.md)."""

THREAD = ("backlash", "lost_share", "lost_steps", "offset", "delay")
FLOW = ("band_lower", "band_upper", "dead_band", "flow_full", "flow_lag")
FITS = ("fit_a_priori", "fit_a_posteriori", "fit_free_run", "pole")
THETA = (
    *(f"a_{i}" for i in range(1, ORDER + 1)),
    *(f"b_{i}" for i in range(1, ORDER + 1)),
    *(f"beta_{k}" for k in range(2, ORDER + 1)),
    *(f"gamma_{k}" for k in range(2, ORDER + 1)),
)

PARAMETERS = (
    Parameter(
        "backlash", "1", "play between screw and spool, in parts of the stroke", 0.0, trend=True
    ),
    Parameter(
        "lost_share",
        "1",
        "share of the steps upwards that slip, less those downwards; resolved to about 1e-4",
        -0.9,
        0.9,
    ),
    Parameter("lost_steps", "1", "steps lost in the cycle", -1e9, 1e9, trend=True),
    Parameter("offset", "1", "spool position minus counted motor position at the cycle's end"),
    Parameter("delay", "s", "counted step to measured position: sensor average and logging", 0.0),
    Parameter(
        "band_lower",
        "1",
        "spool position at which the lower flow begins",
        0.0,
        1.0,
        trend=True,
        resolution=EDGE,
        sided=("band", "lower"),
    ),
    Parameter(
        "band_upper",
        "1",
        "spool position at which the upper flow begins",
        0.0,
        1.0,
        trend=True,
        resolution=EDGE,
        sided=("band", "upper"),
    ),
    Parameter(
        "dead_band", "1", "band_upper - band_lower", 0.0, 1.0, trend=True, resolution=2.0 * EDGE
    ),
    Parameter("flow_full", "1", "flow at full opening, unit of the mapped flow", 0.0, trend=True),
    Parameter("flow_lag", "s", "time constant of the flow meter", 0.0),
    *(
        Parameter(name, "1", f"paper 004, eq. (7): {name}, about the centre of the stroke")
        for name in THETA
    ),
    Parameter("fit_a_priori", "%", "one-step fit before a sample is learned", upper=100.0),
    Parameter("fit_a_posteriori", "%", "paper 004, eq. (10): after it is learned", upper=100.0),
    Parameter(
        "fit_free_run", "%", "simulation of the cycle with its last parameters", upper=100.0
    ),
    Parameter("pole", "1", "largest pole of the linear part, before it is projected", 0.0),
)


@dataclass(frozen=True, slots=True)
class StepperServoNumbers:
    """Known constants of the valve."""

    step_size: float = quantity(
        0.01 / 2.1, "1", "travel of a full step over the stroke", 1e-6, 0.5
    )


StepperServoTolerances = tolerance_section(
    "StepperServoTolerances", __name__, StepperServoNumbers, {"step_size": 0.002}
)


@dataclass(frozen=True, slots=True)
class StepperServoOptions(StepperServoNumbers, ModelOptions):
    """Options of the model."""

    estimators: tuple[str, ...] = setting(
        (MECHANICS, WIENER),
        "estimators to run; backlash_output_error always runs: it feeds trend and prediction",
        choices=(MECHANICS, WIENER, FEATURES),
    )
    max_backlash: float = assumed(0.3, "1", "upper bound of the backlash", 1e-4, 1.0)
    max_delay_s: float = assumed(0.1, "s", "longest delay tried", 0.0, 10.0)
    min_motion: float = assumed(0.02, "1", "a cycle that moves less is refused", 0.0, 1.0)
    min_fit: float = assumed(
        50.0,
        "%",
        "a cycle whose position the screw explains worse, free run, is refused: "
        "swapped, inverted or wrongly scaled signals",
        -1000.0,
        100.0,
    )
    centre: float = quantity(
        0.5, "1", "position about which the Hammerstein-Wiener model counts", -10, 10
    )
    na: int = quantity(2, "1", "past outputs of the Hammerstein-Wiener model", 1, ORDER)
    nb: int = quantity(2, "1", "past inputs", 1, ORDER)
    nk: int = quantity(0, "samples", "delay of its input, 0 = the one found", 0, MAX_LAG)
    nl: int = quantity(3, "1", "highest power of its static parts, 1 = linear", 1, ORDER)
    forgetting: float = quantity(1.0, "1", "weight of the past a sample", 0.5, 1.0)
    tolerances: object = field(default_factory=StepperServoTolerances)
