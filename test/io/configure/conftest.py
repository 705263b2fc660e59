# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Proposals for what does not depend on the model: one is tried instead of all."""

import pytest

from valve_twin.core.survey import sides, trial
from valve_twin.core.valves.registry import get_model
from valve_twin.io.configure import survey


@pytest.fixture
def no_black_box(monkeypatch):
    """Try the models of valves, and no black box beside them: half of the CPU of a choice."""
    for module in (survey, sides):
        monkeypatch.setattr(module, "try_baseline", lambda *_, **__: None)


@pytest.fixture
def one_model(monkeypatch, no_black_box):
    """Try the example of a valve alone, and no black box beside it."""
    monkeypatch.setattr(trial, "_valves", lambda: [get_model("first_order")])
