# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The parameters of the valves that a node hosts."""

from pathlib import Path

import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters

from test.nodes.conftest import NS
from valve_twin.nodes.aging.node import AgingMonitorNode
from valve_twin.nodes.twin.node import TwinNode
from valve_twin.nodes.twin.valve_parameters import absolute_url


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
    assert len(listed) < 200
    assert [n for n in listed if n.startswith(("aging.thresholds", "aging.comm"))] == [given]
    assert node.parameters.given()[given] == 7.0


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
