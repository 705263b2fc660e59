# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""An analytic stand-in for the field computation, and what searches need."""

from __future__ import annotations

import pytest

from valve_twin.design.geometry import DoubleStroke
from valve_twin.design.search.archive import Archive, header_of
from valve_twin.design.search.tasks import Outcome


class StandIn:
    """A bowl in radius and gap; the loss rises with the preload; turns are for the window."""

    def __init__(self):
        self.keys = []

    def __call__(self, tasks):
        for task in tasks:
            self.keys.append((task.key, task.fidelity))
            yield self.outcome(task)

    def outcome(self, task):
        known = (task.key, task.fidelity, task.values)
        broken = task.design.violations()
        if broken:
            return Outcome(*known, error=str(broken[0]), broken=0.1)
        if task.design.valve.preload > 27.0:
            return Outcome(*known, error="a line that says why")
        a = task.design.armature_radius / 8e-3 - 1.0
        b = task.design.gap_ratio / 0.1875 - 1.0
        figures = {
            "rise_s": 3e-3 * (1.0 + (a + 0.05) ** 2 + b),
            "settling_s": 6e-3 * (1.0 + (a + 0.03) ** 2 + b),
            "graded_s": 6e-3 * (1.0 + (a + 0.03) ** 2 + b),
            "loss": 1.0 + task.design.valve.preload / 100.0,
            "overshoot": 0.02,
            "error": 0.001,
            "heating": 10.0,
            "margin": 50.0,
        }
        curves = {"force": (1.0 + a, 4.0 + 4.0 * a), "flux": (1.0 + b,)}
        return Outcome(*known, figures, curves, cpu_s=0.1)


@pytest.fixture
def stand_in():
    return StandIn()


@pytest.fixture
def design():
    return DoubleStroke()


@pytest.fixture
def archive(design, tmp_path):
    return Archive(tmp_path / "archive.jsonl", header_of(design, ""))
