# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The profile of the middleware: there for the first node only, never in place of a user's own."""

import os
from pathlib import Path
from xml.etree import ElementTree

import pytest
from valve_twin_msgs.msg import Float64Stamped

from test.nodes.player.test_flow_control import TOPICS, write_bag
from valve_twin.nodes.runtime.transport import profile

VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
VARIABLE = VARIABLES[profile.is_fast_dds_3()]
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"


@pytest.fixture(autouse=True)
def fresh(monkeypatch):
    """No profile is set before and none is left behind."""
    monkeypatch.setenv(RANGE, "SUBNET")
    for name in (*VARIABLES, "FASTDDS_BUILTIN_TRANSPORTS"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(profile, "_quick", [])
    yield
    profile.remove_profile_file()


def test_the_profile_stands_until_the_first_node_has_read_it():
    profile.use_fast_heartbeat()
    path = Path(os.environ[VARIABLE])
    name = "heartbeat_period" if profile.is_fast_dds_3() else "heartbeatPeriod"
    (period,) = ElementTree.parse(path).findall(".//{*}" + name)
    assert [part.text for part in period] == ["0", "10000000"]
    assert profile.has_fast_heartbeat()
    profile.remove_profile_file()
    assert not path.exists()
    assert VARIABLE not in os.environ
    assert profile.has_fast_heartbeat()


def transports() -> list[str | None]:
    return [
        e.text for e in ElementTree.parse(os.environ[VARIABLE]).findall(".//{*}builtinTransports")
    ]


def test_a_player_keeps_off_shared_memory_unless_the_user_says_otherwise(monkeypatch):
    profile.use_fast_heartbeat(over_udp=True)
    assert transports() == ["UDPv4"]
    profile.remove_profile_file()
    profile.use_fast_heartbeat()
    assert transports() == []
    profile.remove_profile_file()
    monkeypatch.setenv("FASTDDS_BUILTIN_TRANSPORTS", "SHM")
    profile.use_fast_heartbeat(over_udp=True)
    assert transports() == []


def test_a_node_may_keep_off_shared_memory_and_ask_no_more_often(monkeypatch):
    profile.keep_off_shared_memory()
    assert transports() == ["UDPv4"]
    assert not ElementTree.parse(os.environ[VARIABLE]).findall(".//{*}publisher")
    assert not profile.has_fast_heartbeat()
    profile.remove_profile_file()
    monkeypatch.setenv("FASTDDS_BUILTIN_TRANSPORTS", "SHM")
    profile.keep_off_shared_memory()
    assert VARIABLE not in os.environ


@pytest.mark.parametrize("name", VARIABLES)
def test_a_user_s_profile_is_left_alone(monkeypatch, tmp_path, name):
    monkeypatch.setenv(name, str(tmp_path / "mine.xml"))
    profile.use_fast_heartbeat()
    profile.remove_profile_file()
    assert os.environ[name] == str(tmp_path / "mine.xml")
    assert not profile.has_fast_heartbeat()


def test_another_middleware_keeps_the_range_that_it_was_given(monkeypatch):
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")
    monkeypatch.setenv(RANGE, "LOCALHOST")
    monkeypatch.setenv("ROS_LOCALHOST_ONLY", "1")
    profile.use_fast_heartbeat(over_udp=True)
    assert VARIABLE not in os.environ
    assert os.environ[RANGE] == "LOCALHOST"
    assert os.environ["ROS_LOCALHOST_ONLY"] == "1"


@pytest.mark.parametrize(
    "variable", [(RANGE, "LOCALHOST"), ("ROS_LOCALHOST_ONLY", "1")], ids=lambda v: v[0]
)
def test_a_player_of_this_machine_alone_keeps_off_shared_memory_too(
    graph, tmp_path, monkeypatch, variable
):
    """The middleware would add it; no segment of it is mapped, and messages come all the same."""
    monkeypatch.setenv(*variable)
    heard = graph.record(f"/replay{TOPICS[0]}", Float64Stamped)
    player = graph.start("bag_player", bag=write_bag(tmp_path / "bag", 10_000))
    graph.spin_until(lambda: len(heard) > 10, 120.0, "messages")
    maps = Path(f"/proc/{player.pid}/maps").read_text()
    assert "/dev/shm/fast" not in maps  # fastrtps_... or fastdds_...


@pytest.mark.parametrize("third", [False, True])
def test_each_middleware_gets_the_names_that_it_knows(monkeypatch, tmp_path, third):
    (tmp_path / "share" / ("fastdds" if third else "fastrtps")).mkdir(parents=True)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    profile.use_fast_heartbeat(over_udp=True)
    text = Path(os.environ[VARIABLES[third]]).read_text()
    assert ("<heartbeat_period>" in text) is ("<nack_response_delay>" in text) is third
    assert ("<heartbeatPeriod>" in text) is ("<nackResponseDelay>" in text) is (not third)
