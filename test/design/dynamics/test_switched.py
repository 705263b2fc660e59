# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A trapezoid whose flux the bridge can make: flanks made longer, G_A derivative, G_F late."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from test.design.dynamics.made import CURVES, answer
from valve_twin.design.dynamics import Bridge, identify_switched, switched
from valve_twin.design.field import Trapezoid

BRIDGE = Bridge(2.0, 24.0)


# what is asked of a field problem here
MODEL: Any = SimpleNamespace(section=SimpleNamespace(coils=("A", "B")))


@pytest.fixture(autouse=True)
def _known(monkeypatch):
    monkeypatch.setattr(switched, "run_transient", answer)


def test_flanks_are_made_longer_until_the_bridge_can_make_the_flux():
    shape = Trapezoid(slope=1e-3, hold=2e-3, rest=2e-3)
    found = identify_switched(MODEL, CURVES, BRIDGE, shape)
    assert found.reached
    assert found.tries > 1
    assert found.shape.slope == pytest.approx(1e-3 * switched.LONGER ** (found.tries - 1))
    assert found.rebuilt.largest <= BRIDGE.limit == pytest.approx(1.32e-3)
    assert found.of_current.fast_gain > 1.0  # derivative, from the switched flux
    assert found.of_current.fit > found.of_current.without + 10.0
    assert found.of_force.fast_gain < 1.0
    assert found.of_force.fit > found.of_force.without + 10.0
    assert found.smooth.fit > found.of_current.fit  # the switching is noise


def test_a_bridge_that_is_too_weak_is_told(monkeypatch):
    monkeypatch.setattr(switched, "_TRIES", 2)
    shape = Trapezoid(slope=1e-3, hold=1e-3, rest=1e-3)
    found = identify_switched(MODEL, CURVES, Bridge(2.0, 3.0), shape)
    assert not found.reached
    assert found.rebuilt.largest > Bridge(2.0, 3.0).limit
