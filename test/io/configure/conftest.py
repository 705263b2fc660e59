# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Proposals for what does not depend on the model: one is tried instead of all."""

import pytest

from valve_twin.core.survey import trial
from valve_twin.core.valves.registry import get_model


@pytest.fixture
def one_model(monkeypatch, no_black_box):
    """Try the example of a valve alone, and no black box beside it."""
    monkeypatch.setattr(trial, "_valves", lambda: [get_model("first_order")])
