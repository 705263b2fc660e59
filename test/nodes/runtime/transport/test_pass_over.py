# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What lies behind a message of 0 bytes is heard once its number is given up."""

import os
import subprocess
import sys

import pytest
from std_msgs.msg import Float64

from test.nodes.conftest import DEEP
from valve_twin.compat.ros import message_and_info, take_with_info
from valve_twin.nodes.runtime.transport import pass_over as module
from valve_twin.nodes.runtime.transport.pass_over import (
    MOST,
    gap,
    own_ports,
    pass_over,
    pass_over_missing,
)

TOPIC, KIND = "/numbers", "std_msgs/msg/Float64"
GUID = list(range(1, 17))
EMPTY = (3, 6, 7)
"""Numbers of the messages of 0 bytes, the first message is number 1."""

PUBLISHER = f"""
import time, rclpy
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64
rclpy.init()
node = rclpy.create_node("other")
publisher = node.create_publisher(Float64, "{TOPIC}", 1000)
while not publisher.get_subscription_count():
    time.sleep(0.01)
for number in range(1, 11):
    text = b"" if number in {EMPTY} else serialize_message(Float64(data=float(number)))
    publisher.publish(text)
time.sleep(120.0)
"""


@pytest.fixture
def other(graph):
    environment = {**os.environ, "ROS_DOMAIN_ID": str(graph.domain)}
    process = subprocess.Popen([sys.executable, "-c", PUBLISHER], env=environment)
    yield process
    process.kill()
    process.wait()


def info(number):
    return {"publication_sequence_number": number}


def test_a_reliable_subscription_loses_nothing_but_the_empty_messages(graph, other):
    heard = []

    def take(*arguments):
        _, said = message_and_info(arguments)
        heard.append(said["publication_sequence_number"])

    take_with_info(graph.node.create_subscription(Float64, TOPIC, take, DEEP, raw=True))
    graph.spin_until(lambda: heard == [1, 2], what="what was sent before the first")
    graph.spin(1.0)
    assert heard == [1, 2], "the middleware hands such messages on: none of this is needed"
    assert pass_over_missing(graph.node, TOPIC, KIND, info(2), info(3))
    graph.spin_until(lambda: heard == [1, 2, 4, 5], 20.0, "what was sent before the second")
    assert pass_over_missing(graph.node, TOPIC, KIND, info(5), info(10))
    graph.spin_until(lambda: heard == [1, 2, 4, 5, 8, 9, 10], 20.0, "what was sent at last")


def test_of_whom_a_message_is_missing_is_known_only_where_there_is_one_publisher(graph):
    assert not pass_over_missing(graph.node, TOPIC, KIND, info(1), info(5))
    graph.node.create_publisher(Float64, TOPIC, 1)
    graph.spin_until(lambda: graph.node.count_publishers(TOPIC) == 1)
    assert pass_over_missing(graph.node, TOPIC, KIND, info(1), info(5))
    assert not pass_over_missing(graph.node, TOPIC, KIND, {}, info(5)), "none was heard"
    graph.node.create_publisher(Float64, TOPIC, 1)
    graph.spin_until(lambda: graph.node.count_publishers(TOPIC) == 2)
    assert not pass_over_missing(graph.node, TOPIC, KIND, info(1), info(5))


def test_nobody_is_told_of_numbers_that_make_no_range(monkeypatch):
    monkeypatch.setattr(module, "own_ports", lambda domain: [1])
    for first, last in ((0, 5), (6, 5), (1, MOST + 1)):
        assert not pass_over(GUID, first, last, 1)


def test_nobody_is_told_under_security_by_another_middleware_or_without_a_port(monkeypatch):
    monkeypatch.setattr(module, "own_ports", lambda domain: [])
    assert not pass_over(GUID, 1, 2, 1)
    monkeypatch.setattr(module, "own_ports", lambda domain: [1])
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    assert not pass_over(GUID, 1, 2, 1)
    monkeypatch.delenv("ROS_SECURITY_ENABLE")
    monkeypatch.setattr(module, "get_rmw_implementation_identifier", lambda: "rmw_cyclonedds_cpp")
    assert not pass_over(GUID, 1, 2, 1)


def test_what_is_said_is_a_gap_of_the_publisher_for_all_its_readers():
    text = gap(bytes(GUID), 5, 2**32 + 6)
    assert text[:8] == b"RTPS\x02\x03\x01\x0f"
    assert list(text[8:20]) == GUID[:12]
    assert text[20:24] == b"\x08\x01\x1c\x00", "GAP, little-endian, 28 bytes"
    assert text[24:28] == bytes(4), "any reader"
    assert list(text[28:32]) == GUID[12:]
    assert text[32:40] == b"\x00\x00\x00\x00\x05\x00\x00\x00"
    assert text[40:48] == b"\x01\x00\x00\x00\x07\x00\x00\x00", "the first that is not meant"
    assert text[48:] == bytes(4), "and no other"


def test_own_ports_are_those_of_the_domain_that_this_process_has_open(tmp_path):
    (tmp_path / "fd").mkdir()
    (tmp_path / "net").mkdir()
    for descriptor, target in enumerate(("socket:[11]", "socket:[12]", "pipe:[13]", "/dev/null")):
        (tmp_path / "fd" / str(descriptor)).symlink_to(target)
    rows = [(7661, 11), (7660, 13), (7662, 14), (40000, 12)]
    lines = [
        f" {n}: 00000000:{port:04X} 00000000:0000 07 0:0 00:0 00 0 0 {inode} 2 0 0"
        for n, (port, inode) in enumerate(rows)
    ]
    (tmp_path / "net" / "udp").write_text("\n".join(["sl local_address", *lines]) + "\n")
    assert own_ports(1, tmp_path) == [7661]
    assert own_ports(2, tmp_path) == []
    assert own_ports(1, tmp_path / "nothing") == []
