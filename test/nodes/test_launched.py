# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`simulated_valve.launch.py` on an installed ROS 2: predictions come and all nodes end with 0.

`colcon test` of an installation with launch_testing runs it; without that it is skipped.
"""

from __future__ import annotations

import re
import tempfile
import time
import unittest
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from valve_twin_msgs.msg import Prediction

REASON = "launch_testing is not installed: apt install ros-*-launch-testing"
actions = pytest.importorskip("launch_testing.actions", reason=REASON)
asserts = pytest.importorskip("launch_testing.asserts", reason=REASON)
markers = pytest.importorskip("launch_testing.markers", reason=REASON)
post_shutdown_test = pytest.importorskip("launch_testing", reason=REASON).post_shutdown_test
launch = pytest.importorskip("launch", reason=REASON)

DOMAIN = 97
NS = "/press/valve_1"
ROOT = Path(__file__).parents[2]
LAUNCHED = ROOT / "launch" / "simulated_valve.launch.py"
HOME = tempfile.TemporaryDirectory(prefix="valve_twin_launched_")
WAIT_S = 120.0
"""A first start compiles kernels [s]."""


def parameters() -> Path:
    """Return a file as users have it, whose history lies where nothing else does."""
    folder = Path(HOME.name)
    text = (ROOT / "config" / "press_cartridge.yaml").read_text(encoding="utf-8")
    own = f'history_url: "sqlite:///{folder / "history.sqlite"}"'
    made, count = re.subn(r'history_url: "[^"]*"', own, text)
    assert count == 1
    path = folder / "valve.yaml"
    path.write_text(made, encoding="utf-8")
    return path


@pytest.mark.launch_test
@markers.keep_alive
def generate_test_description() -> Any:
    """Start what a user starts, without a recording."""
    return launch.LaunchDescription(
        [
            launch.actions.SetEnvironmentVariable("ROS_DOMAIN_ID", str(DOMAIN)),
            launch.actions.SetEnvironmentVariable("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST"),
            launch.actions.IncludeLaunchDescription(
                launch.launch_description_sources.PythonLaunchDescriptionSource(str(LAUNCHED)),
                launch_arguments={
                    "namespace": NS,
                    "params_file": str(parameters()),
                    "rate": "10.0",
                    "record": "false",
                    "log_level": "warn",
                }.items(),
            ),
            actions.ReadyToTest(),
        ]
    )


class TestWhileItRuns(unittest.TestCase):
    """The nodes are up."""

    def test_predictions_come(self) -> None:
        context = Context()
        rclpy.init(context=context, domain_id=DOMAIN)
        node = Node("listener", context=context)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        found: list[Any] = []
        node.create_subscription(Prediction, f"{NS}/twin/prediction", found.append, 100)
        end = time.monotonic() + WAIT_S
        while len(found) < 100 and time.monotonic() < end:
            executor.spin_once(timeout_sec=0.1)
        node.destroy_node()
        rclpy.shutdown(context=context)
        assert len(found) >= 100


@post_shutdown_test()
class TestAfterTheEnd(unittest.TestCase):
    """Ctrl-C has ended all."""

    def test_all_nodes_end_in_good_order(self, proc_info: Any) -> None:
        asserts.assertExitCodes(proc_info)
