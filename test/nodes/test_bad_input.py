# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Whatever a user writes wrongly is told with name, value and remedy, and no node dies of it."""

from pathlib import Path

import pytest
import yaml
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically

from test.nodes.conftest import NS
from valve_twin.nodes.aging.node import AgingMonitorNode
from valve_twin.nodes.player.node import BagPlayerNode
from valve_twin.nodes.simulator.node import SimulatedValveNode
from valve_twin.nodes.twin.node import TwinNode

CONFIG = Path(__file__).resolve().parents[2] / "config"


@pytest.fixture
def history(tmp_path):
    return {"history_url": f"sqlite:///{tmp_path}/history.sqlite"}


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        (
            {"signals.v_in.type": "sensor_msgs/msg/JointStat"},
            ["signal 'v_in'", "sensor_msgs/msg/JointStat", "install its package or correct"],
        ),
        (
            {"signals.v_in.field": "valu"},
            ["signal 'v_in'", "no field 'valu'", "did you mean 'value'?"],
        ),
        (
            {"signals.v_in.type": "sensor_msgs/msg/JointState", "signals.v_in.field": "position"},
            ["signal 'v_in'", "is an array", "write position[0]"],
        ),
        (
            {"signals.v_in.topic": ""},
            ["'signals.v_in.topic'", "is empty", "write the topic"],
        ),
        (
            {"model": "pres_cartridge"},
            ["'model'", "pres_cartridge", "did you mean 'press_cartridge'?"],
        ),
        ({"period_s": -0.03}, ["'period_s'", "-0.03", "write 1e-06 to 3600"]),
        ({"period_s": "fast"}, ["'period_s'", "'fast'", "write for example"]),
        ({"signals.v_in.scale": 0.0}, ["'signals.v_in.scale'", "0.0", "other than 0"]),
        (
            {"cycles.rule": "reference"},
            ["'cycles.rule'", "reference", "write signals.reference.topic"],
        ),
        (
            {"cycles.start_signal": "v_on"},
            ["'cycles.start_signal'", "v_on", "did you mean 'v_in'?"],
        ),
    ],
)
def test_a_wrong_value_is_told_and_the_node_stays_to_be_configured(
    graph, capfd, history, parameters, words
):
    node = graph.host(TwinNode, **history, **parameters)
    said = capfd.readouterr().err
    assert "cannot configure" in said
    assert [w for w in words if w not in said] == []
    assert "Traceback" not in said
    assert node.state == "unconfigured"


def test_a_wrong_model_is_one_line(graph, capfd):
    """Nothing that belongs to the right one is called unknown."""
    text = yaml.safe_load((CONFIG / "press_cartridge.yaml").read_text())
    given = {**text["/**"]["ros__parameters"], "model": "pres_cartridge"}
    graph.host(TwinNode, **given)
    said = [line for line in capfd.readouterr().err.splitlines() if line.startswith("[")]
    assert len(said) == 1
    assert "did you mean 'press_cartridge'?" in said[0]


def test_a_twin_without_a_valve_makes_no_database(graph, capfd, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    node = graph.host(TwinNode)
    assert node.state == "unconfigured"
    assert "no valve is described: give --params-file" in capfd.readouterr().err
    assert not list(tmp_path.glob("*.sqlite*"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "there is no such file"),
        ("", "no section with"),
        ("/other/twin:\n  ros__parameters:\n    model: press_cartridge\n", "holds nothing for"),
    ],
)
def test_a_wrong_parameter_file_ends_the_start_with_one_line(graph, tmp_path, text, words):
    path = tmp_path / "valves.yaml"
    if text is not None:
        path.write_text(text)
    process = graph.start("twin", extra=["--params-file", str(path)], alone=True)
    assert process.process.wait(60.0) == 1
    assert words in process.log
    assert len(process.log.splitlines()) == 1


def test_a_command_line_that_ros_does_not_take_is_no_traceback(graph, tmp_path):
    process = graph.start("twin", extra=["-p", "model"])
    assert process.process.wait(60.0) == 1
    assert "cannot start" in process.log
    assert "Traceback" not in process.log


def test_an_unknown_key_is_named_with_the_nearest_valid_one(graph, capfd, history):
    node = graph.host(TwinNode, **history, **{"cycles.min_cycl_s": 2.0})
    said = capfd.readouterr().err
    assert (
        "'cycles.min_cycl_s' is unknown and has no effect: did you mean 'cycles.min_cycle_s'?"
        in said
    )
    assert node.state == "active"


def test_an_integer_is_taken_for_a_number(graph, capfd, history):
    node = graph.host(TwinNode, **history, **{"hold_back_s": 1, "signals.v_in.offset": 0})
    assert node.state == "active"
    assert node.get_parameter("hold_back_s").value == 1.0
    assert "ERROR" not in capfd.readouterr().err


def test_a_history_that_cannot_be_opened_is_named_with_its_file(graph, capfd, tmp_path):
    broken = tmp_path / "broken.sqlite"
    broken.write_bytes(b"this is no database" * 100)
    node = graph.host(TwinNode, history_url=f"sqlite:///{broken}")
    assert str(broken) in capfd.readouterr().err
    assert node.state == "unconfigured"


def test_a_missing_bag_is_named(graph, capfd, tmp_path):
    node = graph.host(BagPlayerNode, bag=str(tmp_path / "nothing"))
    said = capfd.readouterr().err
    assert "cannot configure" in said
    assert "nothing" in said
    assert node.state == "unconfigured"


def test_a_player_without_a_bag_says_which_key_to_write(graph, capfd):
    graph.host(BagPlayerNode)
    assert "key 'bag' is empty; write the folder of a bag" in capfd.readouterr().err


def test_a_wrong_setting_of_the_simulation_is_named(graph, capfd):
    node = graph.host(SimulatedValveNode, **{"simulation.aging.area_inn.rate": -0.01})
    said = capfd.readouterr().err
    assert "area_inn" in said
    assert "did you mean 'area_in'?" in said
    assert node.state == "unconfigured"


def test_a_corrected_parameter_lets_the_same_node_be_configured(graph, capfd, history):
    node = graph.host(AgingMonitorNode, **history, **{"hold_back_s": -1.0})
    assert node.state == "unconfigured"
    capfd.readouterr()
    from rclpy.parameter import Parameter

    results = node.set_parameters([Parameter("hold_back_s", Parameter.Type.INTEGER, 1)])
    assert results[0].successful
    node.start()
    assert node.state == "active"


def test_a_parameter_of_the_structure_is_refused_while_configured(graph, history):
    from rclpy.parameter import Parameter

    node = graph.host(TwinNode, **history)
    result = node.set_parameters([Parameter("period_s", Parameter.Type.DOUBLE, 0.05)])[0]
    assert not result.successful
    assert "clean up the node" in result.reason


def test_a_value_of_no_type_is_answered_and_told_once(graph, tmp_path):
    """A stranger can call as often as he likes; each call left a trace of 25 lines, unanswered."""
    process = graph.start("bag_recorder", bag=str(tmp_path / "bag"))
    value = ParameterValue(type=255)
    for kind, name in (
        (SetParameters, "set_parameters"),
        (SetParametersAtomically, "set_parameters_atomically"),
    ):
        for _ in range(3):
            answer = graph.call(
                kind, f"{NS}/bag_recorder/{name}", parameters=[Parameter(name="x", value=value)]
            )
            result = answer.results[0] if kind is SetParameters else answer.result
            assert not result.successful
            assert "type 255" in result.reason
    process.end()
    assert "Traceback" not in process.log
    assert process.log.count("parameter refused") == 1
