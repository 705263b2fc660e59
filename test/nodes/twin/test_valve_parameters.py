# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The parameters of the valves that a node hosts."""

from pathlib import Path

import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters

from test.nodes.conftest import NS
from valve_twin.core.valves.registry import get_model
from valve_twin.io.config.keys import valve_keys
from valve_twin.nodes.aging.node import AgingMonitorNode
from valve_twin.nodes.twin.node import TwinNode
from valve_twin.nodes.twin.valve_parameters import absolute_url, shared_out


@pytest.mark.parametrize(
    ("url", "absolute"),
    [
        ("h.sqlite", "{}/h.sqlite"),
        ("sqlite:///a/h.sqlite", "sqlite:///{}/a/h.sqlite"),
        ("sqlite:////a/h.sqlite", "sqlite:////a/h.sqlite"),
        ("postgresql://user@host/name", "postgresql://user@host/name"),
        ("sqlite:///:memory:", "sqlite:///:memory:"),
        ("", ""),
    ],
)
def test_a_history_is_named_from_the_root(url, absolute):
    assert absolute_url(url) == absolute.format(Path.cwd())


def test_a_twin_says_where_its_history_lies(graph, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    graph.host(TwinNode, history_url="h.sqlite")
    assert f"history {tmp_path}/h.sqlite" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("kind", "name"), [(TwinNode, "twin"), (AgingMonitorNode, "aging_monitor")]
)
def test_what_every_followed_parameter_may_be_given_is_a_parameter_on_use(
    graph, tmp_path, kind, name
):
    given = "aging.thresholds.K_in.value"
    node = graph.host(kind, history_url=f"{tmp_path}/h.sqlite", **{given: 7.0})
    listed = graph.call(ListParameters, f"{NS}/{name}/list_parameters").result.names
    assert len(listed) < 150
    assert [n for n in listed if n.startswith(("aging.thresholds", "aging.comm"))] == [given]
    assert node.parameters.given()[given] == 7.0


def test_a_signal_that_a_plant_may_lack_and_tolerances_have_parameters_on_use(graph, tmp_path):
    given = "signals.temperature.scale"
    node = graph.host(TwinNode, history_url=f"{tmp_path}/h.sqlite", **{given: 2.0})
    listed = graph.call(ListParameters, f"{NS}/twin/list_parameters").result.names
    lacking = {n for n in listed if n.startswith(("signals.temperature", "options.tolerances"))}
    assert lacking == {"signals.temperature.topic", given}
    assert node.parameters.given()[given] == 2.0


def test_a_long_table_is_shared_out():
    """A twin of the servo system had 288 of these 563."""
    keys = valve_keys(get_model("servo_system"))
    always, on_use = shared_out(keys)
    assert len(always) < 215
    assert {k.name for k in (*always, *on_use)} == {k.name for k in keys}
    assert "options.tolerances.density" in {k.name for k in on_use}


def test_one_of_them_is_read_and_described_by_its_name_as_ever(graph, tmp_path):
    graph.host(TwinNode, history_url=f"{tmp_path}/h.sqlite")
    names = ["signals.temperature.scale", "aging.thresholds.K_in.value"]
    values = graph.call(GetParameters, f"{NS}/twin/get_parameters", names=names).values
    assert [v.type for v in values] == [ParameterType.PARAMETER_DOUBLE] * 2
    assert values[0].double_value == 1.0
    asked = ["signals.temperature.offset"]
    (told,) = graph.call(
        DescribeParameters, f"{NS}/twin/describe_parameters", names=asked
    ).descriptors
    assert told.type == ParameterType.PARAMETER_DOUBLE


def set_of(graph, name: str, number: float):
    """Set a parameter of the twin as `ros2 param set` does; return success and reason."""
    value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=number)
    asked = [Parameter(name=name, value=value)]
    (answer,) = graph.call(SetParameters, f"{NS}/twin/set_parameters", parameters=asked).results
    return answer.successful, answer.reason


def test_one_of_them_is_set_by_its_name_and_refused_misspelt(graph, tmp_path):
    graph.host(TwinNode, history_url=f"{tmp_path}/h.sqlite").trigger_deactivate()
    graph.hosted[0].trigger_cleanup()
    name = "aging.thresholds.K_out.value"
    assert set_of(graph, name, 5.0) == (True, "")
    (value,) = graph.call(GetParameters, f"{NS}/twin/get_parameters", names=[name]).values
    assert value.double_value == 5.0
    done, reason = set_of(graph, "aging.thresholds.K_outt.value", 5.0)
    assert not done
    assert f"did you mean '{name}'" in reason


def test_one_of_them_that_is_misspelt_in_a_file_is_told(graph, tmp_path, capfd):
    wrong = {"aging.thresholds.K_ot.value": 7.0}
    graph.host(TwinNode, history_url=f"{tmp_path}/h.sqlite", **wrong)
    said = capfd.readouterr().err
    assert "aging.thresholds.K_ot.value" in said
    assert "'aging.thresholds.K_out.value'" in said
