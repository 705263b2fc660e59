# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A node's loop keeps nothing; nodes on a /clock that two publishers fight over end in order."""

import itertools
import random
import re
import signal
import time

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from valve_twin_msgs.msg import Faults, Prediction
from valve_twin_msgs.srv import ClearFaults

from test.nodes.conftest import NS
from test.nodes.feeding import START_NS, Feeder
from test.programmed import programmed
from valve_twin.nodes.aging.node import AgingMonitorNode
from valve_twin.nodes.runtime.stamps import to_time

LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
S = 10**9
END_S = 5.0
JUMPS = 2000
YEARS_NS = 1_700_000_000 * S


def fighting(seed: int):
    """Yield what two simulations say at once, now and then a third that has just begun [ns]."""
    rng = random.Random(seed)
    for k in itertools.count():
        yield 1_000 * S + k * 10_000_000
        yield 1_100 * S + k * 30_000_000
        if rng.random() < 0.02:
            yield rng.choice([1, S, 2**31 * S - 1])


@pytest.mark.parametrize(
    ("name", "executor"),
    [
        ("twin", "events"),
        ("twin", "single_threaded"),
        ("aging_monitor", "events"),
        ("bag_recorder", "events"),
        ("simulated_valve", "events"),
    ],
)
def test_a_node_ends_within_5_s_after_thousands_of_jumps(graph, tmp_path, name, executor):
    own: dict[str, dict[str, object]] = {
        "twin": {"model": "press_cartridge", "history_url": f"sqlite:///{tmp_path}/h.sqlite"},
        "aging_monitor": {"model": "press_cartridge"},
        "bag_recorder": {"bag": str(tmp_path / "bag")},
        "simulated_valve": {"model": "press_cartridge", "clock": False},
    }
    node = graph.start(name, use_sim_time=True, executor=executor, **own[name])
    predictions = graph.record(f"{NS}/twin/prediction", Prediction)
    clocks = [graph.node.create_publisher(Clock, "/clock", 10) for _ in range(2)]
    graph.spin_until(clocks[0].get_subscription_count, what="a listener")
    graph.wait_log(node, "is active")
    feeder = None
    if name == "twin":
        graph.be_heard(f"{NS}/twin")
        feeder = Feeder(graph, NS)
    stamps = fighting(1)
    for k in range(JUMPS):
        clocks[k % 2].publish(Clock(clock=to_time(next(stamps))))
        if feeder is not None and k % 4 == 0:  # the data's stamps are those of either clock
            feeder.feed(1, START_NS + k // 4 % 2 * YEARS_NS)
        graph.executor.spin_once(timeout_sec=0.0)
        time.sleep(0.001)
    graph.spin_until(lambda: name != "twin" or predictions, what="predictions")
    for publisher in clocks:  # it goes on while the node ends
        publisher.publish(Clock(clock=to_time(next(stamps))))
    code, took_s = node.end_in_s(signal.SIGINT)
    assert code == 0, node.log[-2000:]
    assert took_s < END_S, f"{took_s:.1f} s\n{node.log[-2000:]}"
    assert "Traceback" not in node.log


def test_a_fleet_without_its_plant_says_so_in_a_few_lines_and_publishes_it_together(
    graph, tmp_path
):
    """Sixty missing topics: each had a line, and a message that held all before it."""
    valves = [f"valve_{i:02d}" for i in range(20)]
    faults = graph.record(f"{NS}/twin/faults", Faults, LATCHED)
    url = f"sqlite:///{tmp_path}/h.sqlite"
    twin = graph.start("twin", valves=valves, model="press_cartridge", history_url=url)

    def missing():
        return [f for f in faults[-1].faults if f.code == "input.missing"] if faults else []

    def lines():
        return [line for line in twin.log.splitlines() if "[input.missing]" in line]

    def told():
        """How many topics the lines tell of: each of one, or of how many more."""
        more = [re.search(r"(\d+) more of \[input.missing\]: ", line) for line in lines()]
        return sum(int(m[1]) if m else 1 for m in more)

    graph.spin_until(lambda: len(missing()) == 60, 120.0, "all missing topics")
    graph.spin_until(lambda: told() == 60, what="lines of all missing topics")
    # the second after which a topic is missing may end between two looks: four lines of each
    assert len(lines()) <= 8, lines()
    assert len(faults) < 10
    assert twin.end() == 0


@pytest.mark.parametrize("given", [None, False, True])
def test_a_node_answers_no_questions_about_message_types_unless_it_is_told_to(graph, given):
    """A stranger's 3 MB in one make rcl write up to 12 MB of log."""
    more = [] if given is None else ["-p", f"start_type_description_service:={given}"]
    arguments = ["--ros-args", "-r", f"__ns:={NS}", *more]
    node = AgingMonitorNode(context=graph.context, cli_args=arguments, use_global_arguments=False)
    graph.hosted.append(node)
    services = [service.srv_name for service in node.services]
    assert any(name.endswith("get_type_description") for name in services) == bool(given)


@pytest.mark.parametrize("count", [100, 400])
def test_many_requests_at_once_are_all_answered(graph, count):
    """The middleware keeps ten of a service by default: the others were never answered."""
    node = graph.host(AgingMonitorNode, start=False)
    deep = QoSProfile(depth=1000)
    client = graph.node.create_client(
        ClearFaults, f"{NS}/{node.get_name()}/clear_faults", qos_profile=deep
    )
    graph.spin_until(client.service_is_ready, what="the service")
    asked = [client.call_async(ClearFaults.Request()) for _ in range(count)]
    graph.spin_until(lambda: all(f.done() for f in asked), 60.0, "all answers")
    graph.node.destroy_client(client)


SPUN = """
import sys
import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from valve_twin.compat.ros import Recess

rclpy.init()
node, executor, recess = rclpy.create_node("spins"), EventsExecutor(), Recess()
executor.add_node(node)

def turns(count):
    for _ in range(count):
        recess.spin(executor, 0.0)

turns(100)
before, of_kind = sys.getallocatedblocks(), sys.getrefcount(recess._kind)
turns(3000)
print(sys.getallocatedblocks() - before < 300, sys.getrefcount(recess._kind) - of_kind)
ended = []
executor.create_task(lambda: (ended.append(1), recess.end()))
recess.spin(executor, 60.0)
print(ended)

class Holds(Recess):
    held = []

    def add_done_callback(self, stop):
        super().add_done_callback(stop)
        self.held.append(stop)

holds = Holds()
for _ in range(100):
    holds.spin(executor, 0.0)
print(len({repr(stop) for stop in Holds.held}), callable(Holds.held[50]))
"""


def test_a_loop_of_the_events_executor_keeps_nothing_and_ends_early(graph):
    """Each turn kept a block and a reference; a function that somebody holds is left alone."""
    assert programmed(SPUN, ROS_DOMAIN_ID=str(graph.domain)) == "True 0\n[1]\n100 True\n"
