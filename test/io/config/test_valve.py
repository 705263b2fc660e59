# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import pytest

from valve_twin.core.alignment import SignalRange
from valve_twin.core.types import CycleRule
from valve_twin.core.valves.registry import get_model
from valve_twin.io.cdr.signals import SERIES_TYPE, STAMPED_TYPE
from valve_twin.io.config.topic_names import resolve_topic
from valve_twin.io.config.valve import load_config, parse_config
from valve_twin.io.errors import ConfigError, ValveTwinError
from valve_twin.io.offline.make_twin import twin_config

MODEL = {"model": "positioner"}


def one(**keys):
    (config,) = parse_config(
        {**MODEL, **{k.replace("__", "."): v for k, v in keys.items()}}, "/twin"
    )
    return config


def test_defaults_make_a_whole_configuration():
    config = one()
    assert config.name == "/valve"
    assert {s: c.topic for s, c in config.signals.items()} == {
        "command": "/valve/command",
        "position": "/valve/position",
    }
    assert config.signals["command"].type == STAMPED_TYPE
    assert config.options.estimators


def test_conditions_are_signals_that_no_model_needs():
    keys = {"temperature.topic": "oil/temperature", "load.topic": "/plc/load", "load.upper": 9}
    config = one(
        **{f"signals.{k}": v for k, v in keys.items()},
        aging__covariates=["load", "stroke"],
        aging__binned=["temperature 10"],
    )
    assert config.signals["temperature"].topic == "/valve/oil/temperature"
    found = twin_config(config, get_model("positioner")).conditions
    assert found == (SignalRange("load", upper=9.0), SignalRange("temperature"))
    assert twin_config(one(), get_model("positioner")).conditions == ()
    assert config.aging.covariates == ("load", "stroke")
    with pytest.raises(ConfigError, match=r'aging.*binned is "load": write a condition'):
        one(aging__binned=["load"])


def test_a_yaml_integer_stands_for_a_number():
    config = one(period_s=1, cycles__window_s=300, signals__command__scale=2)
    assert (config.period_s, config.cycles.window_s) == (1.0, 300.0)
    assert type(config.signals["command"].scale) is float


def test_the_node_and_the_command_read_the_same(yaml_file):
    text = "model: positioner\nperiod_s: 0.5\ncycles:\n  rule: window\n"
    (loaded,) = load_config(yaml_file(text))
    flat = {"model": "positioner", "period_s": 0.5, "cycles.rule": "window"}
    assert [loaded] == parse_config(flat, "/valve/twin", namespace="/valve")
    assert loaded.cycles.rule is CycleRule.WINDOW


def test_the_namespace_is_the_valve():
    (config,) = parse_config(MODEL, "/twin", namespace="/press/valve_3")
    assert config.name == "/press/valve_3"
    assert config.signals["position"].topic == "/press/valve_3/position"


def test_one_process_hosts_many_valves():
    flat = {
        **MODEL,
        "valves": ["a/b", "c"],
        "period_s": 1.0,
        "a/b.period_s": 2.0,
        "c.signals.command.topic": "/plc/c",
    }
    first, second = parse_config(flat, "/twin", namespace="/plant")
    assert (first.name, first.period_s) == ("/plant/a/b", 2.0)
    assert (second.name, second.period_s) == ("/plant/c", 1.0)
    assert second.signals["command"].topic == "/plc/c"
    assert first.signals["command"].topic == "/plant/a/b/command"


def test_sections_of_a_node_override_the_common_one(tmp_path):
    path = tmp_path / "plant.yaml"
    path.write_text(
        "/**:\n  ros__parameters: {model: positioner, period_s: 1.0}\n"
        "/press/v1/twin:\n  ros__parameters: {period_s: 2.0}\n"
        "/press/v2/twin:\n  ros__parameters: {hold_back_s: 3.0}\n"
        "/press/v1/aging_monitor:\n  ros__parameters: {period_s: 9.0}\n",
        encoding="utf-8",
    )
    found = [(c.name, c.period_s, c.hold_back_s) for c in load_config(path)]
    assert found == [("/press/v1", 2.0, 2.0), ("/press/v2", 1.0, 3.0)]


TOPICS = [
    ("position", "/press/v1", "", "/press/v1/position"),
    ("/plc/x", "/press/v1", "", "/plc/x"),
    ("position", "/press/v1", "/sim", "/sim/press/v1/position"),
    ("/plc/x", "/press/v1", "replay/", "/replay/plc/x"),
]


@pytest.mark.parametrize(("topic", "valve", "prefix", "absolute"), TOPICS)
def test_topics_are_resolved(topic, valve, prefix, absolute):
    assert resolve_topic(topic, valve, prefix) == absolute


def test_the_prefix_stands_before_every_topic():
    config = one(topic_prefix="/sim", signals__command__topic="/plc/x")
    assert [s.topic for s in config.signals.values()] == ["/sim/plc/x", "/sim/valve/position"]


def test_fields_follow_from_the_type():
    config = one(signals__command__type=SERIES_TYPE, signals__position__type="std_msgs/Float64")
    assert config.signals["command"].field == "values[]"
    assert config.signals["position"].field == "data"
    assert config.signals["position"].type == "std_msgs/msg/Float64"


def test_service_limits_are_records_by_parameter():
    config = one(aging__thresholds__rate_rising__value=-20)
    (limit,) = config.aging.thresholds
    assert (limit.parameter, limit.value, limit.relative) == ("rate_rising", -20.0, True)


def test_the_simulation_is_passed_on():
    assert one(simulation__measurement__noise=1e-3).simulation == {"measurement.noise": 1e-3}


def test_keys_of_nodes_and_of_ros_are_no_faults():
    one(autostart=True, use_sim_time=True, qos_overrides__x=1)


BAD = [
    ({"perod_s": 1.0}, r"key 'perod_s': is unknown; did you mean 'period_s'\?"),
    ({"cycles.rul": "window"}, r"key 'cycles.rul': is unknown; did you mean 'cycles.rule'\?"),
    (
        {"options.max_delay": 1},
        r"key 'options.max_delay': is unknown; did you mean 'options.max_delay_s'",
    ),
    ({"aging.reference_cycle": 1}, r"did you mean 'aging.reference_cycles'\?"),
    (
        {"aging.thresholds.rate_risin.value": 1.0},
        r"did you mean 'aging.thresholds.rate_rising.value'",
    ),
    ({"signals.comand.topic": "x"}, r"did you mean 'signals.command.topic'\?"),
    ({"model": "positoner"}, r"key 'model': 'positoner' is unknown; did you mean 'positioner'\?"),
    ({"period_s": "fast"}, r"key 'period_s': value 'fast' is no number; write for example 0.03"),
    ({"period_s": 0}, r"key 'period_s': value 0.0 s is outside its limits; write 1e-06 to 3600"),
    ({"cycles.rule": "windw"}, r"value 'windw' is unknown; write one of commands, counter"),
    (
        {"cycles.rule": "counter"},
        r"'counter' needs the signal 'cycle_counter'; write signals.cycle_c",
    ),
    ({"cycles.rule": "reference"}, r"'reference' needs the signal 'reference'; write signals.ref"),
    (
        {"cycles.start_signal": "v_in"},
        r"'v_in' is no command of model 'positioner'; there are comm",
    ),
    (
        {"cycles.max_cycle_s": 0.5},
        r"value 0.5 s is not above cycles.min_cycle_s = 1.0 s; raise it",
    ),
    ({"signals.position.topic": ""}, r"'signals.position.topic': is empty; write the topic"),
    (
        {"signals.position.type": "Joint"},
        r"'Joint' is no message type; write it as package/msg/Name",
    ),
    (
        {"signals.position.scale": 0},
        r"makes every sample useless; write a finite number other than 0",
    ),
    (
        {"signals.position.offset": float("inf")},
        r"value inf makes every sample useless; write a fin",
    ),
    (
        {"signals.position.lower": 2.0, "signals.position.upper": 1.0},
        r"2.0 is not below upper = 1.0",
    ),
    (
        {"aging.reference_cycles": 1},
        r"'aging.reference_cycles': value 1 is outside its limits; write 2 or",
    ),
    (
        {"aging.thresholds.delay.relative": True},
        r"'aging.thresholds.delay.value' is missing; write",
    ),
    ({"valves": "a"}, r"key 'valves': value 'a' is no list of texts"),
    ({"valves": ["a b"]}, r"key 'valves': 'a b' is no name; write letters, digits and _ only"),
    (
        {"valves": ["a", "a"]},
        r"key 'valves': 'a' stands twice; give every valve a name of its own",
    ),
    (
        {"valves": ["x/a"], "x/b.period_s": 1.0},
        r"there is no valve 'x/b' in 'valves'; did you mean 'x/a'",
    ),
]


@pytest.mark.parametrize(("keys", "says"), BAD)
def test_wrong_keys_and_values_are_named_with_the_remedy(keys, says):
    with pytest.raises(ConfigError, match=says) as caught:
        parse_config({**MODEL, **keys}, "/press/twin")
    text = str(caught.value)
    assert text.startswith("/press/twin: ")
    assert "\n" not in text
    assert isinstance(caught.value, ValveTwinError)


def test_a_file_is_named_with_the_line(yaml_file):
    path = yaml_file("model: positioner\nvalves: [a]\na:\n  period_s: quick\n")
    with pytest.raises(ConfigError, match=r"valve.yaml:6: key 'a.period_s': value 'quick'"):
        load_config(path)


def test_the_same_valve_twice_is_refused(tmp_path):
    path = tmp_path / "plant.yaml"
    path.write_text(
        "/a/twin:\n  ros__parameters: {model: positioner, valves: [b/c]}\n"
        "/a/b/twin:\n  ros__parameters: {model: positioner, valves: [c]}\n",
        encoding="utf-8",
    )
    with pytest.raises(ConfigError, match="'/a/b/c' stands twice"):
        load_config(path)
