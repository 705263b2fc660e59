# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a twin's process loads to predict, and what it leaves to the process that estimates."""

import subprocess
import sys

import pytest

PREDICTS = """
import sys
import valve_twin.nodes.twin.node
from valve_twin.core.types import CycleRule
from valve_twin.core.valves.registry import get_model
from valve_twin.nodes.twin.estimation_job import warm_up, warm_up_prediction

kinds = [("press_cartridge", CycleRule.WINDOW, get_model("press_cartridge").options)]
warm_up_prediction(kinds)
of_estimation = (
    "valve_twin.core.aging.assess",
    "valve_twin.core.diagnosis.history",
    "valve_twin.core.estimation.cycle.sequence",
    "valve_twin.core.past.columns",
    "valve_twin.core.valves.press_cartridge.cycle_estimates",
    "valve_twin.core.valves.press_cartridge.estimation.kalman",
    "valve_twin.core.valves.press_cartridge.plant",
    "valve_twin.io.history.fleet",
)
print([name for name in of_estimation if name in sys.modules])
warm_up(kinds)
print([name for name in of_estimation[2:3] + of_estimation[4:7] if name not in sys.modules])
"""


def test_a_twin_predicts_without_what_estimates_and_judges():
    """Its start would take a fifth longer: the process beside it loads that, before any job."""
    pytest.importorskip("rclpy", reason="needs ROS 2")
    done = subprocess.run(
        [sys.executable, "-c", PREDICTS], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines() == ["[]", "[]"]
