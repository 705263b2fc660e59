# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What known constants, Coulomb friction and the rounding of the currents leave in doubt.

The flights are linear enough in a constant over its tolerance: it moves the residual, and the
least squares answer with the parameters. Coulomb friction looks much like damping; all cycles
together tell them apart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.types import EstimateStatus
from valve_twin.core.valves.hybrid_actuator.flight import FlightProblem
from valve_twin.core.valves.hybrid_actuator.parameters import ESTIMATOR

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from valve_twin.core.types import Estimate, FloatArray
    from valve_twin.core.valves.hybrid_actuator.flight import FlightFit, Flights
    from valve_twin.core.valves.hybrid_actuator.parameters import HybridActuatorOptions
    from valve_twin.core.valves.kit.tolerances import Tolerated

_SHOWN = 4.0  # standard errors from which Coulomb friction is told [1]


@dataclass(frozen=True, slots=True)
class Friction:
    """Coulomb friction as all cycles together tell it: mean and standard error [N]."""

    mean: float
    error: float

    def shown(self, option: float) -> bool:
        """Tell whether it is more than the options say [N]."""
        return self.mean - option > _SHOWN * self.error


def pooled_friction(fit: FlightFit, earlier: Sequence[Estimate]) -> Friction:
    """Return the mean Coulomb friction of this cycle and of those before.

    Parameters
    ----------
    fit : FlightFit
        Of this cycle.
    earlier : sequence of Estimate
        Estimates so far.
    """
    known = [
        e.value("rubbing")
        for e in earlier
        if e.estimator == ESTIMATOR and e.status is not EstimateStatus.REFUSED
    ]
    series = [value for value in known if np.isfinite(value)]
    series.append(fit.rubbing.friction)
    return Friction(float(np.mean(series)), fit.rubbing.error / float(np.sqrt(len(series))))


def by_constants(
    fit: FlightFit,
    record_of: Callable[[HybridActuatorOptions], Flights],
    options: HybridActuatorOptions,
    constants: Tolerated,
) -> FloatArray:
    """Return what a constant moved by its standard deviation changes in what flights tell.

    Parameters
    ----------
    fit : FlightFit
        Of the options as they are.
    record_of : callable
        Returns the record in SI units as options read it.
    options : HybridActuatorOptions
        The options.
    constants : Tolerated
        The K constants.

    Returns
    -------
    (3 + S, K) array
        Spring rate [N/m], damping [N s/m], magnet force [N], and the speeds at the seats of the S
        strokes [m/s].
    """
    strokes = list(fit.strokes)

    def problem_of(changed: HybridActuatorOptions) -> FlightProblem:
        return FlightProblem(record_of(changed), strokes, changed.armature(), changed.magnetics())

    problem, inverse = problem_of(options), np.linalg.pinv(fit.jacobian)
    here, speeds = problem.residuals(fit.unknowns), np.array(fit.seating)
    moved = np.empty((3 + len(strokes), len(constants.names)))
    for k, (name, sigma) in enumerate(zip(constants.names, constants.sigmas, strict=True)):
        value = getattr(options, name) * (1.0 + float(sigma))
        aside = problem_of(replace(options, **{name: value}))
        unknowns = fit.unknowns - inverse @ (aside.residuals(fit.unknowns) - here)
        seats = [aside.seating(unknowns, j) for j in range(len(strokes))]
        moved[:3, k] = (unknowns - fit.unknowns)[:3]
        moved[3:, k] = np.array(seats) - speeds
    return moved
