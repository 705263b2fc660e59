# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What our nodes say on /diagnostics, by the rules of diagnostic_aggregator and of ros2_medkit.

Aggregator: an analyzer takes a status whose name is matched as a whole by one of `regex`, is one
of `expected`, begins with one of `startswith` or holds one of `contains`
(diagnostic_aggregator/src/generic_analyzer.cpp). Medkit: a code of capitals, digits and single
underscores from the name, at most 128 long; WARN = 1, ERROR = 2, STALE = 3, OK heals
(ros2_medkit_diagnostic_bridge, README).
"""

from __future__ import annotations

import ast
import re
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from test.nodes.conftest import NS
from valve_twin.nodes.aging.node import AgingMonitorNode
from valve_twin.nodes.recorder.node import BagRecorderNode
from valve_twin.nodes.simulator.node import SimulatedValveNode
from valve_twin.nodes.twin.node import TwinNode

ROOT = Path(__file__).parents[3]
MOST_CODE = 128
NODES = {"twin", "aging_monitor", "bag_recorder", "gateway", "opcua_source", "simulated_valve"}
EXAMPLES = {
    "valve.name": ("/press/valve_1", "/press/valve_11"),
    "name": ("/press/valve_2",),
    "given.address": ("opc.tcp://plc:4840", "opc.tcp://10.0.0.7:4840/x"),
}
"""What stands in the names of the reports, by the expression in the source."""


@cache
def analyzers() -> dict[str, dict[str, Any]]:
    file = yaml.safe_load((ROOT / "config" / "diagnostics.yaml").read_text(encoding="utf-8"))
    found = file["analyzers"]["ros__parameters"]
    return {name: given for name, given in found.items() if isinstance(given, dict)}


def taken_by(name: str) -> list[str]:
    """Return the analyzers that take a status of a name."""
    return [
        a
        for a, given in analyzers().items()
        if any(re.fullmatch(r, name) for r in given.get("regex", ()))
        or name in given.get("expected", ())
        or any(name.startswith(s) for s in given.get("startswith", ()))
        or any(s in name for s in given.get("contains", ()))
    ]


def medkit_code(name: str) -> str:
    """Return the code that the bridge makes of a name."""
    return re.sub(r"[^A-Z0-9]+", "_", name.upper()).strip("_")


@cache
def reports() -> frozenset[str]:
    """Return the names of all reports that the sources of the nodes make, filled by examples."""
    found: set[str] = set()
    for path in sorted((ROOT / "valve_twin" / "nodes").rglob("*.py")):
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Name)):
                continue
            if call.func.id == "Report":
                found.update(spelled(call.args[0]))
    return frozenset(found)


def spelled(text: ast.expr) -> set[str]:
    if isinstance(text, ast.Constant):
        return {str(text.value)}
    assert isinstance(text, ast.JoinedStr), ast.unparse(text)
    parts = [
        EXAMPLES[ast.unparse(p.value)]
        if isinstance(p, ast.FormattedValue)
        else (str(ast.literal_eval(p)),)
        for p in text.values
    ]
    return {"".join(chosen) for chosen in product(*parts)}


def names() -> list[str]:
    namespaces = ("", "/press", "/press/valve_1")
    return [f"{n}/{node}: {r}" for n in namespaces for node in sorted(NODES) for r in reports()]


def test_every_report_of_the_sources_falls_under_one_analyzer():
    assert len(reports()) >= 6
    for name in names():
        assert len(taken_by(name)) == 1, name
    used = {taken_by(name)[0] for name in names()}
    assert used == set(analyzers()), "an analyzer that nothing falls under"


@pytest.mark.parametrize("foreign", ["camera: node", "/lidar: scan", "battery", "/x: valve 7"])
def test_what_others_say_is_left_to_others(foreign):
    assert taken_by(foreign) == []


def test_every_analyzer_is_one_that_the_aggregator_can_make():
    keys = {"type", "path", "regex", "expected", "startswith", "contains", "timeout"}
    for given in analyzers().values():
        assert given["type"] == "diagnostic_aggregator/GenericAnalyzer"
        assert set(given) <= keys
        assert isinstance(given["timeout"], float)  # read with as_double()
    paths = [given["path"] for given in analyzers().values()]
    assert len(set(paths)) == len(paths)


def test_every_report_has_a_code_of_its_own_that_medkit_takes():
    codes = {name: medkit_code(name) for name in names()}
    assert len(set(codes.values())) == len(codes)
    for code in codes.values():
        assert re.fullmatch(r"[A-Z0-9_]+", code)
        assert len(code) <= MOST_CODE
    example = "/press/valve_1/twin: valve /press/valve_1"
    text = (ROOT / "config" / "medkit.yaml").read_text(encoding="utf-8")
    assert f'"{example}" is the fault {medkit_code(example)}:' in text


def test_the_manifest_of_medkit_names_a_valve_as_the_source_of_its_faults():
    manifest = yaml.safe_load((ROOT / "config" / "medkit_manifest.yaml").read_text("utf-8"))
    (app,) = manifest["apps"]
    binding = app["ros_binding"]
    assert f"{binding['namespace']}/{binding['node_name']}" in EXAMPLES["valve.name"]
    assert app["is_located_on"] in {c["id"] for c in manifest["components"]}
    assert {c["area"] for c in manifest["components"]} <= {a["id"] for a in manifest["areas"]}
    gateway = yaml.safe_load((ROOT / "config" / "medkit.yaml").read_text("utf-8"))
    given = gateway["ros2_medkit_gateway"]["ros__parameters"]["discovery"]["manifest_path"]
    assert given == "medkit_manifest.yaml"


def test_what_nodes_say_falls_under_an_analyzer_and_is_a_fault_of_its_valve(graph, tmp_path):
    history = {"history_url": f"sqlite:///{tmp_path}/history.sqlite"}
    graph.host(TwinNode, **history)
    graph.host(AgingMonitorNode)
    graph.host(BagRecorderNode, bag=str(tmp_path / "bag"))
    graph.host(SimulatedValveNode, ns="/sim/press/v1")
    diagnostics = graph.record("/diagnostics", DiagnosticArray)

    def told() -> dict[str, DiagnosticStatus]:
        return {s.name: s for array in diagnostics for s in array.status}

    wanted = {f"{NS}/{n}: node" for n in ("twin", "aging_monitor", "bag_recorder")}
    wanted.add("/sim/press/v1/simulated_valve: node")
    graph.spin_until(lambda: wanted <= set(told()), what="the diagnostics of all nodes")
    parameters = yaml.safe_load((ROOT / "config" / "medkit.yaml").read_text(encoding="utf-8"))
    assert parameters["diagnostic_bridge"]["ros__parameters"]["use_hardware_id_as_source_id"]
    codes = set()
    for name, status in told().items():
        assert len(taken_by(name)) == 1, name
        assert status.level in (b"\x00", b"\x01", b"\x02", b"\x03")
        assert status.message, name  # becomes the fault's description
        codes.add(medkit_code(name))
        if taken_by(name)[0] in {"twins", "aging"}:
            assert status.hardware_id == NS  # becomes the fault's source: it holds a slash
    assert len(codes) == len(told())
