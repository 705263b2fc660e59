# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Nodes come up, change their state and go down in good order."""

import errno
import inspect
import signal
import sqlite3
import statistics
import time
from functools import partial
from pathlib import Path
from unittest.mock import Mock

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Log
from rclpy.impl import rcutils_logger

from test.bag_samples import write_sample
from test.nodes.conftest import NS, NodeProcess
from valve_twin.compat import ros
from valve_twin.io.bags.writer import BagWriter
from valve_twin.io.errors import BagError, ConfigError
from valve_twin.nodes.aging.node import AgingMonitorNode
from valve_twin.nodes.gateway.node import GatewayNode
from valve_twin.nodes.opcua_source.node import OpcuaSourceNode
from valve_twin.nodes.player.node import BagPlayerNode
from valve_twin.nodes.recorder.node import BagRecorderNode
from valve_twin.nodes.runtime import node as runtime
from valve_twin.nodes.simulator.node import SimulatedValveNode
from valve_twin.nodes.twin.node import TwinNode

NODES = {
    "twin": TwinNode,
    "simulated_valve": SimulatedValveNode,
    "aging_monitor": AgingMonitorNode,
    "bag_player": BagPlayerNode,
    "bag_recorder": BagRecorderNode,
    "opcua_source": OpcuaSourceNode,
    "gateway": GatewayNode,
}
LIMIT_S = 2.0


@pytest.fixture
def parameters(tmp_path):
    """Parameters that let every node run."""
    with BagWriter(tmp_path / "bag") as writer:
        write_sample(writer, "/press/v1/spool_position", 10**9, 0.5)
    history = {"history_url": f"sqlite:///{tmp_path}/history.sqlite"}
    return {
        "twin": history,
        "simulated_valve": {"rate": 20.0},
        "aging_monitor": history,
        "bag_player": {"bag": str(tmp_path / "bag")},
        "bag_recorder": {"bag": str(tmp_path / "recorded")},
        "opcua_source": {"tags": ["position ns=2;i=1"], "address": "opc.tcp://127.0.0.1:1"},
        "gateway": {"port": 0, **history},
    }


@pytest.mark.parametrize("name", NODES)
def test_every_state_is_reached_and_left_again(graph, parameters, name):
    node = graph.host(NODES[name], autostart=False, **parameters[name])
    assert node.state == "unconfigured"
    states = []
    for step in ("configure", "activate", "deactivate", "activate", "deactivate", "cleanup"):
        getattr(node, f"trigger_{step}")()
        graph.spin_until(lambda: True)
        states.append(node.state)
    assert states == ["inactive", "active", "inactive", "active", "inactive", "unconfigured"]


def test_a_transition_that_the_state_does_not_know_is_answered(graph):
    node = graph.host(SimulatedValveNode)
    again = Transition(id=Transition.TRANSITION_CONFIGURE)
    answer = graph.call(ChangeState, f"{NS}/simulated_valve/change_state", transition=again)
    assert not answer.success
    assert node.state == "active"


@pytest.mark.parametrize("name", NODES)
def test_either_signal_ends_a_running_node_within_two_seconds(graph, parameters, name):
    numbers = (signal.SIGTERM, signal.SIGINT, signal.SIGTERM)
    given = [dict(parameters[name]) for _ in numbers]
    if name == "bag_recorder":
        for i, one in enumerate(given):
            one["bag"] += str(i)
    running = [graph.start(name, f"{NS}{i}", **one) for i, one in enumerate(given)]
    graph.spin_until(
        lambda: (
            graph.node.get_node_names().count(name) == len(running)
            and all(process.takes_signals() for process in running)
        ),
        what="the nodes",
    )
    took = [ended_in_s(*one) for one in zip(running, numbers, strict=True)]
    assert statistics.median(took) < LIMIT_S, took


def ended_in_s(process: NodeProcess, number: signal.Signals) -> float:
    """End a node by a signal; return how long that took with a core free [s]."""
    code, took_s = process.end_in_s(number)
    assert code == 0, process.log
    assert "Traceback" not in process.log
    return took_s


def test_a_second_interrupt_during_the_end_does_no_harm(graph, parameters):
    process = graph.start("twin", **parameters["twin"])
    graph.spin_until(lambda: "twin" in graph.node.get_node_names(), what="the node")
    graph.wait_log(process, "cycles go on from")
    process.process.send_signal(signal.SIGINT)
    while process.process.poll() is None:
        process.process.send_signal(signal.SIGINT)
        time.sleep(0.005)
    assert process.process.returncode == 0, process.log
    assert "Traceback" not in process.log


@pytest.mark.parametrize("name", ["twin", "bag_recorder"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_after_the_shutdown_by_service_ends_the_process(graph, parameters, name, number):
    process = graph.start(name, **parameters[name])
    end = Transition(id=Transition.TRANSITION_ACTIVE_SHUTDOWN)
    graph.wait_log(process, "is active")
    assert graph.call(ChangeState, f"{NS}/{name}/change_state", transition=end).success
    assert process.end(number) == 0
    assert "Traceback" not in process.log
    assert "ERROR" not in process.log


def test_a_line_of_log_tells_its_place_and_reads_no_source(graph, monkeypatch):
    """It read each file on the way: 40 ms of CPU of a start, for lines that nobody uses."""
    monkeypatch.setattr(rcutils_logger, "inspect", inspect)  # as it was, also at the end
    ros.log_without_sources()
    read = Mock(return_value=([""], 0))
    monkeypatch.setattr(inspect, "findsource", read)
    lines = graph.record("/rosout", Log)
    graph.spin_until(lambda: graph.connected("/rosout"))
    graph.node.get_logger().info("here")
    (told,) = graph.spin_until(lambda: [m for m in lines if m.msg == "here"])
    written = Path(__file__).read_text().splitlines()[told.line - 1]
    assert (told.file, written.strip()) == (__file__, 'graph.node.get_logger().info("here")')
    assert told.function == test_a_line_of_log_tells_its_place_and_reads_no_source.__name__
    read.assert_not_called()


class Waiting(BagRecorderNode):
    """A recorder that a disk, or a user's mistake, keeps from starting so many times."""

    def __init__(self, left: int, cause: Exception | None, *, bare=False, **kwargs) -> None:
        self.left, self.cause, self.tries, self.bare = left, cause, 0, bare
        super().__init__(**kwargs)

    def configure(self) -> None:
        self.tries += 1
        if self.tries <= self.left:
            if self.bare and self.cause is not None:
                raise self.cause
            msg = "/data/bag: cannot be written"
            raise BagError(msg) from self.cause
        super().configure()


@pytest.mark.parametrize(
    "cause", [OSError(errno.ENOSPC, "No space left"), sqlite3.Error("attempt: readonly database")]
)
def test_a_start_that_a_disk_keeps_back_is_tried_again_and_told_once(
    graph, tmp_path, monkeypatch, capfd, cause
):
    monkeypatch.setattr(runtime, "RETRY_S", 0.05)
    node = graph.host(partial(Waiting, 3, cause), bag=str(tmp_path / "bag"))
    graph.spin_until(lambda: node.state == "active", what="a start")
    told = capfd.readouterr().err
    assert told.count("cannot configure: /data/bag: cannot be written") == 1
    assert told.count("is configured: what kept it from that is over") == 1
    assert node.tries == 4


class Held(BagRecorderNode):
    """A recorder whose activation a disk holds up so many times."""

    left = 3

    def activate(self) -> None:
        self.left -= 1
        if self.left >= 0:
            msg = "/data/state: cannot be written"
            raise BagError(msg) from OSError(errno.EROFS, "Read-only file system")
        super().activate()


def test_an_activation_that_a_disk_keeps_back_is_tried_again_and_told_once(
    graph, tmp_path, monkeypatch, capfd
):
    """The node stayed inactive for good."""
    monkeypatch.setattr(runtime, "RETRY_S", 0.05)
    node = graph.host(Held, bag=str(tmp_path / "bag"))
    assert node.state == "inactive"
    graph.spin_until(lambda: node.state == "active", what="a start")
    told = capfd.readouterr().err
    assert told.count("cannot activate: /data/state: cannot be written") == 1
    assert "is configured: what kept it from that" not in told
    assert node._retry is None


def test_who_cleans_up_a_node_that_waits_for_its_disk_has_it_left_alone(
    graph, tmp_path, monkeypatch
):
    monkeypatch.setattr(runtime, "RETRY_S", 0.2)
    node = graph.host(Held, bag=str(tmp_path / "bag"))
    assert node._retry is not None
    node.trigger_cleanup()
    graph.spin(0.5)
    assert node.state == "unconfigured"


def test_an_error_of_the_system_that_nobody_put_into_words_is_told_once_too(
    graph, tmp_path, monkeypatch, capfd
):
    monkeypatch.setattr(runtime, "RETRY_S", 0.05)
    cause = OSError(errno.EIO, "Input/output error")
    node = graph.host(partial(Waiting, 3, cause, bare=True), bag=str(tmp_path / "bag"))
    graph.spin_until(lambda: node.state == "active", what="a start")
    assert capfd.readouterr().err.count("cannot configure: OSError") == 1


def test_a_start_that_a_mistake_keeps_back_is_not_tried_again_and_told_whenever_it_is_asked_for(
    graph, tmp_path, monkeypatch, capfd
):
    monkeypatch.setattr(runtime, "RETRY_S", 0.0)
    node = graph.host(partial(Waiting, 9, ConfigError("a mistake")), bag=str(tmp_path / "bag"))
    graph.spin(0.3)
    assert node.tries == 1
    node.trigger_configure()
    assert capfd.readouterr().err.count("cannot configure: /data/bag: cannot be written") == 2


def test_a_player_whose_disk_is_not_there_yet_says_so_in_one_line_and_plays_once_it_is(
    graph, tmp_path, monkeypatch, capfd
):
    monkeypatch.setattr(runtime, "RETRY_S", 0.05)
    bag = tmp_path / "disk/bag"
    node = graph.host(BagPlayerNode, bag=str(bag))
    with BagWriter(bag) as writer:
        write_sample(writer, "/press/v1/spool_position", 10**9, 0.5)
    graph.spin_until(lambda: node.state == "active", what="a start")
    told = capfd.readouterr().err
    assert told.count(f"cannot configure: {bag}: there is no such file; give a bag folder") == 1
    assert "Traceback" not in told


def test_a_node_that_a_user_configures_meanwhile_is_left_to_him(graph, tmp_path, monkeypatch):
    monkeypatch.setattr(runtime, "RETRY_S", 0.2)
    cause = OSError(errno.ENOSPC, "No space left")
    node = graph.host(partial(Waiting, 1, cause), bag=str(tmp_path / "bag"))
    node.trigger_configure()
    node.trigger_cleanup()
    graph.spin(0.5)
    assert (node.state, node.tries) == ("unconfigured", 2)
