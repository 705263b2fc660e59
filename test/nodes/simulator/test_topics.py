# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""An FMU made from a law as the valve of `simulated_valve`: a twin estimates its parameters."""

import pytest
from valve_twin_msgs.msg import Estimate, Faults

from test.gateway.fmu.test_valve import made, record
from test.nodes.conftest import NS
from valve_twin.core.types import ParameterValue
from valve_twin.gateway.fmu.export import write_fmu
from valve_twin.gateway.fmu.valve import valve_of
from valve_twin.io.errors import ConfigError
from valve_twin.nodes.simulator.node import SimulatedValveNode

pytest.importorskip("fmpy")
pytest.importorskip("ziglang")
pytestmark = pytest.mark.timeout(900)  # the first use of the compiler builds its C libraries

VALUES = (ParameterValue("time_constant", 0.7), ParameterValue("dead_band", 0.02))
VALVE = {
    "model": "first_order",
    "period_s": 0.05,
    "topic_prefix": "/sim",
    "signals.command.topic": "command/command",
    "signals.position.topic": "spool_position",
    "cycles.rule": "window",
    "cycles.window_s": 20.0,
}


@pytest.fixture(scope="module")
def fmu(tmp_path_factory):
    path = tmp_path_factory.mktemp("fmu") / "valve.fmu"
    write_fmu(valve_of("db", "/v", made(values=VALUES), record()), path, 3)
    return str(path)


def test_a_twin_estimates_the_parameters_of_an_fmu(graph, fmu):
    found = graph.record(f"{NS}/twin/estimate", Estimate)
    graph.start("twin", history_url=f"sqlite:///{graph.folder}/history.sqlite", **VALVE)
    graph.spin_until(lambda: graph.connected(f"{NS}/twin/estimate"), what="the twin")
    graph.be_heard(f"{NS}/twin")
    graph.host(
        SimulatedValveNode,
        **VALVE,
        **{"simulation.fmu.file": fmu, "rate": 0.0, "start_time_s": 1000.0},
        stop_after_cycles=4,
        wait_for_subscribers=1,
    )
    graph.spin_until(lambda: len(found) >= 2, what="two estimates")
    for estimate in found:
        values = dict(zip(estimate.names, estimate.values, strict=True))
        assert values["time_constant"] == pytest.approx(0.7, rel=0.01)
        assert values["dead_band"] == pytest.approx(0.02, abs=0.003)


def test_an_fmu_that_is_not_there_is_one_line(graph):
    given = {**VALVE, "simulation.fmu.file": "/gone/valve.fmu"}
    node = graph.host(SimulatedValveNode, start=False, **given)
    with pytest.raises(ConfigError, match=r"fmu\.file = /gone/valve\.fmu: there is no"):
        node.configure()


def test_an_fmu_that_takes_no_leak_says_so_as_a_fault(graph, fmu):
    faults = graph.record(f"{NS}/simulated_valve/faults", Faults)
    graph.host(
        SimulatedValveNode,
        **VALVE,
        **{"simulation.fmu.file": fmu, "simulation.fault.kind": "leak", "rate": 0.0},
        **{"simulation.fault.severity": 0.1, "simulation.fault.start_s": 1.0},
        wait_for_subscribers=0,
    )

    def told():
        return [f for m in faults[-1:] for f in m.faults if f.code == "simulation.failed"]

    graph.spin_until(told, what="the fault")
    assert "takes neither a leak nor process noise" in told()[0].evidence
