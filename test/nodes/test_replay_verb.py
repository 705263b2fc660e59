# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin replay` on real DDS: a recorded valve comes back under its prefix and ends."""

import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from rosgraph_msgs.msg import Clock
from valve_twin_msgs.msg import Float64Stamped

from test.bag_samples import write_sample
from valve_twin.io.bags.read import BagWriter
from valve_twin.nodes.runtime.stamps import from_time

START_NS = 1_600_000_000_000_000_000
TOPIC = "/press/v1/spool_position"
ATTENDED = ("--wait-for-subscribers", "1")


@pytest.fixture
def bag(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for n in range(200):
            write_sample(writer, TOPIC, START_NS + n * 30_000_000, n / 8)
    return tmp_path / "bag"


def replay(graph, *arguments):
    command = [sys.executable, "-m", "valve_twin.cli", "replay", *map(str, arguments)]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(graph.domain)}
    return subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def test_every_message_comes_back_and_the_command_ends(graph, bag):
    found = graph.record(f"/replay{TOPIC}", Float64Stamped)
    process = replay(graph, bag, "--rate", "0", *ATTENDED)
    graph.spin_until(lambda: process.poll() is not None, 120.0, "end of the replay")
    _, told = process.communicate()
    assert process.returncode == 0, told
    graph.spin_until(lambda: len(found) == 200, what="200 messages")
    np.testing.assert_array_equal([m.value for m in found], np.arange(200) / 8)


def test_a_missing_bag_is_told_in_one_line(graph, tmp_path):
    process = replay(graph, tmp_path / "gone")
    _, told = process.communicate(timeout=120)
    assert process.returncode == 1
    assert told.count("\n") == 1
    assert f"{tmp_path / 'gone'}: there is no such file; give a bag folder" in told


def test_the_options_of_ros2_bag_play_are_understood(graph, bag):
    found = graph.record("/replay/other", Float64Stamped)
    clock = graph.record("/clock", Clock)
    process = replay(
        graph,
        *(bag, "-r", "0", "--clock", "-e", "spool", "-x", "command", "-d", "0.1"),
        *("-m", f"{TOPIC}:=/other", "--wait-for-all-acked", "2000", *ATTENDED),
        *("--start-offset", "3", "--playback-until-nsec", str(START_NS + 110 * 30_000_000)),
    )
    graph.spin_until(lambda: process.poll() is not None, 120.0, "end of the replay")
    _, told = process.communicate()
    assert process.returncode == 0, told
    graph.spin_until(lambda: len(found) == 11, what="11 messages")
    np.testing.assert_array_equal([m.value for m in found], np.arange(100, 111) / 8)
    graph.spin_until(lambda: clock, what="the clock")
    assert from_time(clock[0].clock) == START_NS + 3 * 10**9


@pytest.mark.parametrize(
    "wrong", [["--start-offset", "-1"], ["--rate", "x"], ["--playback-duration", "nan"]]
)
def test_a_wrong_option_is_told_in_one_line(graph, bag, wrong):
    process = replay(graph, bag, *wrong)
    _, told = process.communicate(timeout=120)
    assert process.returncode == 2
    assert told.count("\n") == 1


def test_a_player_that_loops_ends_on_a_signal(graph, bag):
    found = graph.record(f"/replay{TOPIC}", Float64Stamped)
    process = replay(graph, bag, "--rate", "0", "--loop", *ATTENDED)
    graph.spin_until(lambda: len(found) > 400, 120.0, "the third round")
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=120)
    assert process.returncode == 0
    values = [m.value for m in found[:400]]
    np.testing.assert_array_equal(values, np.tile(np.arange(200) / 8, 2))
