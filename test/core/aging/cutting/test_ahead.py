# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is searched ahead is searched once."""

import importlib

import numpy as np

from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.aging.cutting import ahead
from valve_twin.core.aging.cutting.memory import Memory
from valve_twin.core.past.columns import past_of
from valve_twin.core.types import Estimate, EstimateStatus, Parameter, ParameterValue

PARAMETERS = (Parameter("gain", "1", "", trend=True),)
CONFIG = AgingConfig(max_candidates=40)


def test_it_looks_ahead_only_where_that_is_due(monkeypatch):
    random = np.random.default_rng(2)
    past = past_of(
        Estimate(
            model="",
            estimator="",
            cycle=n,
            start_ns=n,
            end_ns=n + 1,
            parameters=(ParameterValue("gain", 1.0 + 1e-3 * random.standard_normal()),),
            status=EstimateStatus.ACCEPTED,
            reason="",
            used_by_trend=True,
        )
        for n in range(1, 204)
    )
    assess = importlib.import_module("valve_twin.core.aging.assess").assess
    calls = []
    monkeypatch.setattr(ahead, "assess", lambda *a, **k: calls.append(assess(*a, **k)))
    memory = Memory()
    ahead.look_ahead(past, (), CONFIG, parameters=PARAMETERS, memory=memory)
    assert not calls
    for _ in range(3):
        assess(past, (), CONFIG, parameters=PARAMETERS, memory=memory)
        ahead.look_ahead(past, (), CONFIG, parameters=PARAMETERS, memory=memory)
    assert len(calls) == 1
