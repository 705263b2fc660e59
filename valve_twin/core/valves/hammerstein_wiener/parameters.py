# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a Hammerstein-Wiener model publishes, and its options."""

from __future__ import annotations

from dataclasses import dataclass

from valve_twin.core.diagnosis.features import ESTIMATOR as FEATURES
from valve_twin.core.quantity import quantity, setting
from valve_twin.core.types import Parameter
from valve_twin.core.valves.hammerstein_wiener.fit import BLOCKS
from valve_twin.core.valves.hammerstein_wiener.kernels import (
    FALL,
    FALL_LIMIT,
    INPUT,
    MAX_LAG,
    MEMORY,
    ORDER,
    OUTPUT,
    RISE,
    RISE_LIMIT,
    A,
    B,
)
from valve_twin.core.valves.hammerstein_wiener.shape import INPUT_KNOTS, OUTPUT_KNOTS
from valve_twin.core.valves.interface import ModelOptions

ESTIMATOR = "output_error"

_UNIT = "in units of the signals"


def _coefficients() -> dict[str, tuple[int, str]]:
    """Return where each coefficient stands among those of the kernels, and what it is."""
    found = {"memory": (MEMORY, "share of the last error that stays for the next sample")}
    for i in range(ORDER):
        found[f"a{i + 1}"] = A + i, f"of the output {i + 1} samples before"
        found[f"b{i + 1}"] = B + i, f"of the command curve, {i} samples before the newest"
    found["rate_up"] = RISE, "share of the way to the target in a sample, rising"
    found["rate_down"] = FALL, "the same, falling"
    found["limit_up"] = RISE_LIMIT, f"longest way in a sample, rising, {_UNIT}"
    found["limit_down"] = FALL_LIMIT, f"the same, falling, {_UNIT}"
    for side, first, count in (("input", INPUT, INPUT_KNOTS), ("output", OUTPUT, OUTPUT_KNOTS)):
        found[f"{side}_knots"] = first, f"knots of the {side} curve"
        found[f"{side}_first"] = first + 1, f"first knot, {_UNIT}"
        found[f"{side}_last"] = first + 2, f"last knot, {_UNIT}"
        for k in range(count):
            found[f"{side}_{k + 1}"] = first + 3 + k, f"level of the curve at a knot, {_UNIT}"
    return found


COEFFICIENTS = _coefficients()
"""Index among the coefficients of the kernels, and meaning, by name."""

FOLLOWED = (
    Parameter(
        "static_gain",
        "1",
        "settled answer per command between a sixth and five sixths of the command's range",
        -1e6,
        1e6,
        trend=True,
    ),
    Parameter(
        "response_rising",
        "s",
        "from a step of the command over this range to 63 % of the answer, rising command",
        0.0,
        trend=True,
        sided=("response", "rising"),
    ),
    Parameter(
        "response_falling",
        "s",
        "the same, falling command",
        0.0,
        trend=True,
        sided=("response", "falling"),
    ),
)
"""What does not depend on the blocks that were chosen."""

PARAMETERS = (*FOLLOWED, *(Parameter(name, "1", text) for name, (_, text) in COEFFICIENTS.items()))
NAMES = tuple(p.name for p in PARAMETERS)


@dataclass(frozen=True, slots=True)
class HammersteinWienerOptions(ModelOptions):
    """Options of the model."""

    blocks: tuple[str, ...] = setting(
        BLOCKS,
        "blocks that may be added to the linear one where they help; none = ARX",
        choices=BLOCKS,
    )
    max_order: int = quantity(3, "1", "highest order of the linear block", 1, ORDER)
    max_lag: int = quantity(8, "samples", "longest command to answer lag tried", 1, MAX_LAG - 1)
    min_samples: int = quantity(100, "1", "a cycle of fewer usable samples is refused", 50, 1e6)
    estimators: tuple[str, ...] = setting(
        (ESTIMATOR,), "estimators to run", choices=(ESTIMATOR, FEATURES)
    )
