# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is done before anybody waits for it: searches of the next verdicts, and compiling."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.aging.wave import find_waves
from valve_twin.core.diagnosis.direct.noise import noisier
from valve_twin.core.diagnosis.watch.memory import warm_up as watch
from valve_twin.core.types import Estimate, EstimateStatus, Parameter, ParameterValue

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.aging.cutting.memory import Memory
    from valve_twin.core.past.columns import Past
    from valve_twin.core.types import Maintenance


def look_ahead(
    history: Past,
    maintenance: Sequence[Maintenance],
    config: AgingConfig,
    *,
    parameters: Sequence[Parameter],
    memory: Memory,
) -> None:
    """Search what later assessments will want, where that is due.

    Parameters
    ----------
    history : Past
        What the last assessment was made of.
    maintenance : sequence of Maintenance
        Its events.
    config : AgingConfig
        Its rules.
    parameters : sequence of Parameter
        What the valve's model publishes.
    memory : Memory
        Takes what is found.
    """
    if memory.due:
        of_trends = replace(history, features=history.features.take(np.arange(0)))
        with memory.ahead():
            assess(of_trends, maintenance, config, parameters=parameters, memory=memory)


def warm_up() -> None:
    """Compile every kernel of the aging monitor, so that no callback has to."""
    cycles = np.arange(60)
    history = [
        Estimate(
            model="",
            estimator="",
            cycle=int(cycle) + 1,
            start_ns=int(cycle),
            end_ns=int(cycle) + 1,
            parameters=(ParameterValue("gain", 1.0 + 1e-3 * float(cycle % 7)),),
            status=EstimateStatus.ACCEPTED,
            reason="",
            used_by_trend=True,
        )
        for cycle in cycles
    ]
    parameters = (Parameter("gain", "1", "", trend=True),)
    assess(history, (), AgingConfig(max_candidates=20), parameters=parameters)
    places = np.linspace(0.0, 1.0, len(cycles))
    find_waves(places, np.sin(20.0 * places), places)
    watch()
    noisier(cycles, np.ones(len(cycles)))
