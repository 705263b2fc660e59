# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The simulated valve in place of the hardware."""

import math

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from valve_twin_msgs.msg import Faults, Float64Series, Float64Stamped
from valve_twin_msgs.srv import InjectFault, SetAging

from test.nodes.conftest import NS
from valve_twin.core.simulation.valve import SimulatedValve
from valve_twin.core.valves.hybrid_actuator.plant_kernel import FLUX_CLOSER, OPEN_CLOSER
from valve_twin.core.valves.registry import get_simulation
from valve_twin.demo.cases import case_names, config_of
from valve_twin.io.config.valve import load_config
from valve_twin.nodes.runtime.stamps import from_time
from valve_twin.nodes.simulator.node import SimulatedValveNode

POSITION = f"/sim{NS}/spool_position"
S = 10**9
FAST = {"rate": 0.0, "start_time_s": 1000.0, "wait_for_subscribers": 0}


def values(messages):
    return [m.value for m in messages]


def newest_ns(messages) -> int:
    """Return the stamp of the newest message [ns]."""
    return from_time(messages[-1].header.stamp)


def told_of(code: str, reports):
    """Return the fault of a code; a busy machine may have another one told before."""
    return next((f for report in reports[-1:] for f in report.faults if f.code == code), None)


def test_it_publishes_what_the_simulation_gives_for_the_seed(graph):
    found = graph.record(POSITION, Float64Stamped)
    graph.host(SimulatedValveNode, seed=3, stop_after_cycles=1, **FAST)
    graph.spin_until(lambda: len(found) >= 300, what="300 positions")
    offset = round((from_time(found[0].header.stamp) * 1e-9 - 1000.0) / 0.03)
    block = SimulatedValve(get_simulation("press_cartridge"), 3).advance(offset + 300)
    assert values(found[:300]) == list(block.position[offset:])


def test_batches_hold_the_same_samples(graph):
    found = graph.record(POSITION, Float64Series)
    graph.host(SimulatedValveNode, batch=25, stop_after_cycles=1, **FAST)
    graph.spin_until(lambda: len(found) >= 4, what="4 batches")
    stamps = [from_time(m.header.stamp) for m in found[:4]]
    assert stamps[1] - stamps[0] == 25 * 30_000_000
    assert len(found[0].values) == 25
    assert found[0].period == pytest.approx(0.03)


@pytest.mark.parametrize(
    ("given", "published"), [({}, True), ({"clock": False}, False), ({"clock": True}, True)]
)
def test_the_clock_is_published_at_another_rate_unless_it_was_refused(graph, given, published):
    clocks = graph.record("/clock", Clock)
    positions = graph.record(POSITION, Float64Stamped)
    graph.host(SimulatedValveNode, rate=20.0, **given)
    graph.spin_until(lambda: len(positions) > 50, what="positions")
    assert bool(clocks) == published


@pytest.mark.alone
def test_the_clock_runs_at_the_rate(graph):
    found: list[tuple[int, int]] = []

    def take(message, info) -> None:
        found.append((from_time(message.clock), info["source_timestamp"]))

    graph.node.create_subscription(Clock, "/clock", take, 1000)
    graph.host(SimulatedValveNode, rate=20.0)
    graph.spin_until(lambda: len(found) > 4000, what="4000 clock messages")
    simulated, wall = np.diff(np.array(found)[::400], axis=0).T  # ten stretches of 0.6 s
    assert np.median(simulated / wall) == pytest.approx(20.0, rel=0.1)


@pytest.mark.parametrize("model", case_names())
def test_it_publishes_where_the_twin_of_the_same_file_listens(graph, model):
    file = config_of(model)
    (config,) = load_config(file)
    node = graph.host(SimulatedValveNode, config.name, ["--params-file", str(file)])
    published = {o.topic for valve in node._valves for o in valve.published_topics}
    assert {s.topic for s in config.signals.values()} <= published


@pytest.mark.parametrize(
    ("source", "topic"),
    [
        ({}, "/sim/press/v1/command/v_in"),
        ({"topic": "oil/fill"}, "/sim/press/v1/oil/fill"),
        ({"topic": "/sim/oil/fill"}, "/sim/oil/fill"),
        ({"topic": "/plant/oil/fill"}, "/sim/plant/oil/fill"),
        ({"topic": "oil/fill", "scale": 0.01}, "/sim/press/v1/command/v_in"),
        ({"topic": "command/v_out"}, "/sim/press/v1/command/v_in"),
    ],
)
def test_a_mapped_signal_is_published_below_the_prefix(graph, source, topic):
    node = graph.host(SimulatedValveNode, **{f"signals.v_in.{k}": v for k, v in source.items()})
    assert node._valves[0]._topics["v_in"] == topic


def test_it_stops_after_the_cycles_asked_for(graph):
    cycles = graph.record(f"/sim{NS}/cycle", Float64Stamped)
    node = graph.host(SimulatedValveNode, stop_after_cycles=1, **FAST)
    graph.spin_until(lambda: node._outbox.sent >= 5 * 850, what="one cycle")
    graph.spin_until(lambda: cycles, what="its number")
    graph.spin(0.3)
    assert set(values(cycles)) == {1.0}
    assert node._outbox.sent == 5 * 850


def test_with_an_external_controller_the_command_topics_move_it(graph):
    found = graph.record(POSITION, Float64Stamped)
    parameters = {"rate": 5.0, "simulation.controller": "external"}  # a busy machine keeps up
    graph.host(SimulatedValveNode, **parameters)
    command = graph.node.create_publisher(Float64Stamped, f"/sim{NS}/command/v_in", 10)
    graph.spin_until(command.get_subscription_count)
    graph.spin_until(lambda: len(found) > 50, what="positions at rest")
    at_rest = found[-1].value
    command.publish(Float64Stamped(value=0.5))
    graph.spin_until(lambda: found[-1].value > at_rest + 0.2, what="a movement")


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (1.7, "v_in = 1.7: must be a number from 0 to 1 [1]; limited"),
        (math.nan, "v_in = nan: must be a number from 0 to 1 [1]; the last one is held"),
    ],
)
def test_a_command_that_is_none_is_told_with_its_range(graph, value, told):
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    reports = graph.record(f"{NS}/simulated_valve/faults", Faults, latched)
    graph.host(SimulatedValveNode, **{"rate": 20.0, "simulation.controller": "external"})
    command = graph.node.create_publisher(Float64Stamped, f"/sim{NS}/command/v_in", 10)
    graph.spin_until(command.get_subscription_count)
    command.publish(Float64Stamped(value=value))
    fault = graph.spin_until(lambda: told_of("simulation.command", reports), what="the fault")
    assert fault.subject == "v_in"
    assert told in fault.evidence


def test_an_integration_that_fails_is_told_with_time_and_state(graph):
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    reports = graph.record("/engine/v1/simulated_valve/faults", Faults, latched)
    given = {"model": "hybrid_actuator", "period_s": 1e-4, "batch": 100, "rate": 1.0}
    node = graph.host(SimulatedValveNode, "/engine/v1", **given)
    state = node._valves[0]._valve._state
    state[FLUX_CLOSER], state[OPEN_CLOSER] = math.nan, 0.0
    fault = graph.spin_until(lambda: told_of("simulation.failed", reports), what="the fault")
    assert "integration failed at " in fault.evidence


def test_a_fault_can_be_injected_and_cleared(graph):
    found = graph.record(POSITION, Float64Stamped)
    cycles = graph.record(f"/sim{NS}/cycle", Float64Stamped)
    graph.host(SimulatedValveNode, rate=5.0)
    graph.spin_until(lambda: found and cycles, what="both topics")
    name = f"{NS}/simulated_valve/inject_fault"
    assert graph.call(InjectFault, name, kind="lost_samples", severity=1.0).success
    graph.spin_until(lambda: newest_ns(cycles) > newest_ns(found) + S, what="no position")
    lost, others = len(found), len(cycles)
    graph.spin_until(lambda: len(cycles) > others + 100)
    assert len(found) == lost
    assert graph.call(InjectFault, name, kind="none").success
    graph.spin_until(lambda: len(found) > lost, what="positions again")


def test_a_wrong_fault_is_refused_with_the_remedy(graph):
    graph.host(SimulatedValveNode)
    answer = graph.call(InjectFault, f"{NS}/simulated_valve/inject_fault", kind="leek")
    assert not answer.success
    assert "must be one of leak, stuck, sensor_freeze, lost_samples, stiction" in answer.message


def test_aging_can_be_set_while_it_runs(graph):
    graph.host(SimulatedValveNode)
    name = f"{NS}/simulated_valve/set_aging"
    answer = graph.call(SetAging, name, parameter="area_in", law="linear", rate=-0.01)
    assert answer.success
    assert "area_in ages by law linear" in answer.message
    wrong = graph.call(SetAging, name, parameter="area_inn", law="linear", rate=-0.01)
    assert not wrong.success
    assert "did you mean 'area_in'?" in wrong.message


def test_what_is_not_compiled_yet_is_compiled_before_it_is_active(graph, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    simulated = graph.start("simulated_valve", fresh=True, model="first_order", period_s=0.05)
    graph.wait_log(simulated, "is active")
    told, active = "numerical kernels were not compiled yet", "is active"
    assert 0 <= simulated.log.find(told) < simulated.log.find(active)
