# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design`: its steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.cli.design import (
    dynamics,
    evaluate,
    export,
    field,
    geometry,
    holding,
    map,
    optimise,
    report,
    sensitivity,
    transient,
)

if TYPE_CHECKING:
    from valve_twin.cli.common import Verbs

STEPS = (
    geometry,
    field,
    holding,
    map,
    transient,
    dynamics,
    evaluate,
    sensitivity,
    optimise,
    report,
    export,
)
"""One module a step, in their order."""


def add(verbs: Verbs) -> None:
    """Add the verb and its steps."""
    text = (
        "Compute a solenoid from its drawing: geometry, field, holding, map, transient, "
        "dynamics, evaluate, sensitivity, optimise, report, export."
    )
    parser = verbs.add_parser("design", help=text, description=text)
    steps = parser.add_subparsers(dest="step", required=True, metavar="STEP")
    for step in STEPS:
        step.add(steps)
