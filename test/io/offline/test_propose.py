# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A proposal for an unknown bag loads, runs, and gives the estimates of the shipped file."""

from __future__ import annotations

import re

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from test.bag_samples import write_sample
from test.io.configure.test_made import cylinder
from valve_twin.cli import main
from valve_twin.core.diagnosis.features import ESTIMATOR
from valve_twin.core.types import CycleRule, EstimateStatus
from valve_twin.io.bags.read import BagWriter
from valve_twin.io.config.valve import load_config
from valve_twin.io.errors import BagError, ConfigError
from valve_twin.io.offline.propose import propose_yaml
from valve_twin.io.offline.run import Record, estimate_bag
from valve_twin.io.offline.simulated_bag import write_simulated_bag
from valve_twin.io.tables.csv_import import import_csv

STORE = get_typestore(Stores.ROS2_JAZZY)
START_NS = 1_577_836_800_000_000_000
CYCLES = 8


def proposed(bag, tmp_path, **kwargs):
    """Return the configuration that is proposed for a bag, read back from its file."""
    file = tmp_path / "proposal.yaml"
    file.write_text(propose_yaml(bag, **kwargs), encoding="utf-8")
    (config,) = load_config(file)
    assert ESTIMATOR in config.options.estimators  # else no fault is ever told
    return config


def estimates(config, bag):
    record = Record()
    for event in estimate_bag(config, bag):
        record.add(event)
    return [e for e in record.estimates if e.estimator != ESTIMATOR]


def medians(found, names):
    """Return the median of each parameter over all cycles but the first."""
    return [
        np.nanmedian([e.value(n) for e in found if e.used_by_trend and e.cycle > 1]) for n in names
    ]


PRESS = """\
/**:
  ros__parameters:
    model: press_cartridge
    period_s: 0.03
    signals:
      v_in: {topic: /line/a}
      v_out: {topic: /line/b}
      spool_position: {topic: /line/c}
    cycles: {start_signal: v_in, rearm_signal: v_out}
"""
EXTRA = """\
      cycle_counter: {topic: /line/d}
      reference: {topic: /line/e}
"""


def press_bag(tmp_path, extra=""):
    """Return a bag of a simulated press valve under topic names that say nothing."""
    file = tmp_path / "shipped.yaml"
    file.write_text(PRESS.replace("    cycles:", f"{extra}    cycles:"), encoding="utf-8")
    (config,) = load_config(file)
    settings = ["measurement.noise=1e-3", "measurement.delay=1"]
    write_simulated_bag(config, tmp_path / "bag", cycles=CYCLES, seed=3, overrides=settings)
    return config, tmp_path / "bag"


@pytest.mark.usefixtures("no_black_box")
@pytest.mark.parametrize("extra", ["", EXTRA])
def test_a_press_bag_gives_the_estimates_of_the_shipped_configuration(tmp_path, extra):
    shipped, bag = press_bag(tmp_path, extra)
    config = proposed(bag, tmp_path)
    for signal in ("v_in", "v_out", "spool_position"):
        assert config.signals[signal].topic == shipped.signals[signal].topic
        assert (config.signals[signal].scale, config.signals[signal].offset) == (1.0, 0.0)
    assert config.period_s == pytest.approx(0.03)
    assert config.cycles.rule is (CycleRule.COUNTER if extra else CycleRule.COMMANDS)
    found, wanted = estimates(config, bag), estimates(shipped, bag)
    assert len({e.cycle for e in found}) == CYCLES
    names = ["K_in", "K_out"]
    assert medians(found, names) == pytest.approx(medians(wanted, names), rel=0.03)


def test_the_boiler_valve_is_followed_with_the_proposal(root, shared, tmp_path):
    (shipped,) = load_config(root / "config" / "boiler_valve.yaml")
    import_csv([shared / "damadics_boiler_valve"], shipped, tmp_path / "bag")
    config = proposed(tmp_path / "bag", tmp_path)
    assert config.model == "positioner"
    assert config.cycles.rule is CycleRule.WINDOW
    assert {s: v.topic for s, v in config.signals.items()} == {
        s: v.topic for s, v in shipped.signals.items()
    }
    found, wanted = estimates(config, tmp_path / "bag"), estimates(shipped, tmp_path / "bag")
    assert len(found) == len(wanted) == 6
    names = ["slew_falling", "rate_falling"]
    assert medians(found, names) == pytest.approx(medians(wanted, names), rel=0.01)


def test_the_cylinder_is_cut_on_its_reference(root, shared, tmp_path):
    (shipped,) = load_config(root / "config" / "eha_cylinder.yaml")
    folder = shared / "eha_cylinder"
    runs = [folder / f"exp_data_{load}_3.csv.gz" for load in (1, 3, 5)]
    import_csv(runs, shipped, tmp_path / "bag")
    config = proposed(tmp_path / "bag", tmp_path)
    assert config.cycles.rule is CycleRule.REFERENCE
    assert config.signals["position"].batched
    assert config.signals["reference"].topic == config.signals["command"].topic
    found = estimates(config, tmp_path / "bag")
    assert len(found) == 6
    assert all(e.status is not EstimateStatus.REFUSED for e in found)
    assert medians(found, ["response_rising"]) == pytest.approx([0.23], abs=0.05)


JOINT_STATE = """\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def joint_state(stamp_ns, position, effort):
    """Return a serialized sensor_msgs/JointState without velocities."""
    time = STORE.types["builtin_interfaces/msg/Time"](
        sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9
    )
    header = STORE.types["std_msgs/msg/Header"](stamp=time, frame_id="")
    message = STORE.types["sensor_msgs/msg/JointState"](
        header, ["a", "b"], np.array(position), np.array([]), np.array(effort)
    )
    return bytes(STORE.serialize_cdr(message, "sensor_msgs/msg/JointState"))


def joint_bag(path, command, position):
    with BagWriter(path) as bag:
        bag.add_topic("/joints", "sensor_msgs/msg/JointState", message_definition=JOINT_STATE)
        for i, (u, y) in enumerate(zip(command, position, strict=True)):
            stamp = START_NS + i * 20_000_000
            bag.write("/joints", joint_state(stamp, (0.4, y), (u,)), log_ns=stamp)
    return path


def answer(n=3000):
    """Return a command that comes back to rest and a valve that follows it after 5 samples."""
    rng = np.random.default_rng(8)
    command = np.repeat(rng.uniform(0.3, 0.9, n // 200), 200) * (np.arange(n) % 400 < 250)
    position = np.zeros(n)
    for k in range(5, n):
        move = np.clip(8.0 * (command[k - 5] - position[k - 1]), -0.9, 1.4)
        position[k] = position[k - 1] + 0.02 * move
    return command, position + rng.normal(0.0, 5e-4, n)


def test_elements_of_arrays_are_tried(tmp_path):
    bag = joint_bag(tmp_path / "bag", *answer())
    config = proposed(bag, tmp_path)
    assert config.signals["position"].field == "position[1]"
    assert config.signals["command"].field == "effort[0]"
    found = estimates(config, bag)
    assert len(found) >= 5
    assert medians(found, ["slew_rising", "slew_falling"]) == pytest.approx([1.4, 0.9], rel=0.03)
    assert np.median([e.lag for e in found]) == pytest.approx(5, abs=1)


def test_the_position_may_be_named_and_must_be_there(tmp_path):
    bag = joint_bag(tmp_path / "bag", *answer())
    config = proposed(bag, tmp_path, position="/joints:position[1]")
    assert config.signals["position"].field == "position[1]"
    with pytest.raises(ConfigError, match=r"'/joints:position' is no numeric field"):
        propose_yaml(bag, position="/joints:position")
    with pytest.raises(BagError, match=r"no command that moves '/joints:position\[0\]'"):
        propose_yaml(bag, position="/joints:position[0]")


def overshooting(n=3000):
    """Return a command that comes back to rest and a valve that rings behind it."""
    command, _ = answer(n)
    position, speed = np.zeros(n), 0.0
    for k in range(5, n):
        speed += 0.02 * (64.0 * (command[k - 5] - position[k - 1]) - 5.0 * speed)
        position[k] = position[k - 1] + 0.02 * speed
    return command, position + np.random.default_rng(9).normal(0.0, 5e-4, n)


@pytest.mark.no_cover
def test_models_are_compared_for_one_command_of_a_bag_as_for_a_table(tmp_path, capsys):
    """A bag got the bare positioner, whatever drove it, and no word of how well it follows."""
    bag = joint_bag(tmp_path / "bag", *overshooting())
    file, table = tmp_path / "bag.yaml", tmp_path / "table.csv"
    assert main(["configure", str(bag), "--out", str(file)]) == 0
    text = file.read_text()
    fits = re.search(r"# free run of the half that was not fitted: positioner ([\d.]+) %, ", text)
    assert fits is not None
    assert float(fits[1]) > 80.0
    assert "ARX" in text
    assert "follows no better than its baselines" in capsys.readouterr().err  # it is linear
    told = ["convert", str(bag), "--config", str(file), "--out", str(table)]
    assert main(told) == 0
    other = tmp_path / "table.yaml"
    assert main(["configure", str(table), "--yes", "--out", str(other)]) == 0
    one, two = load_config(file)[0], load_config(other)[0]
    assert (one.model, one.options.second_order) == (two.model, two.options.second_order)
    assert one.options.second_order


@pytest.mark.no_cover
@pytest.mark.usefixtures("no_black_box")
def test_two_commands_of_a_bag_are_held_against_what_else_follows(tmp_path, capsys):
    _, bag = press_bag(tmp_path)
    text = propose_yaml(bag)
    assert re.search(r"# free run of each later cycle: press_cartridge 9[5-9]\.\d %, ", text)
    assert "doubt" not in text
    command, ram = cylinder(11)
    with BagWriter(tmp_path / "ram") as made:
        made.add_topic("/joints", "sensor_msgs/msg/JointState", message_definition=JOINT_STATE)
        for i, (u, y) in enumerate(zip(command, 0.01 * ram, strict=True)):
            stamp = START_NS + i * 20_000_000
            both = (max(u, 0.0), max(-u, 0.0))
            made.write("/joints", joint_state(stamp, (0.4, y), both), log_ns=stamp)
    file = tmp_path / "ram.yaml"
    assert main(["configure", str(tmp_path / "ram"), "--out", str(file)]) == 0
    assert "doubt: integrator follows the difference of both" in capsys.readouterr().err
    assert load_config(file)[0].model == "press_cartridge"
    table = tmp_path / "ram.csv"
    told = ["convert", str(tmp_path / "ram"), "--config", str(file), "--out", str(table)]
    assert main(told) == 0
    assert main(["configure", str(table), "--yes", "--out", str(file)]) == 0
    assert load_config(file)[0].model == "integrator"


def test_the_proposal_says_what_each_value_rests_on(tmp_path):
    text = propose_yaml(joint_bag(tmp_path / "bag", *answer()))
    assert "correlation of the increments" in text
    assert "median step; 100 % lie within a tenth of it, 0 gaps [s]" in text
    assert "#   /joints:position[0]" in text
    assert all(len(line.split("#")[0]) < 80 for line in text.splitlines())


def test_the_command_writes_the_proposal(tmp_path, capsys):
    bag = joint_bag(tmp_path / "bag", *answer())
    file = tmp_path / "valve.yaml"
    assert main(["configure", str(bag), "--out", str(file)]) == 0
    assert main(["estimate", str(bag), "--config", str(file)]) == 0
    assert '"model": "positioner"' in capsys.readouterr().out


def nothing_moves(path):
    with BagWriter(path) as bag:
        for i in range(200):
            write_sample(bag, "/still", START_NS + i * 10_000_000, 1.0)
    return path


def nothing_there(path):
    with BagWriter(path):
        pass
    return path


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            nothing_moves,
            r"no command .*\(/still:value\); /still:value stays at 1; give --position",
        ),
        (nothing_there, r"no command that moves a position .*\(none\); write the configuration"),
        (lambda path: path, "there is no such file"),
    ],
)
def test_a_bag_without_a_valve_gives_one_clear_line(tmp_path, capsys, make, message):
    bag = make(tmp_path / "bag")
    with pytest.raises(BagError, match=message):
        propose_yaml(bag)
    assert main(["configure", str(bag)]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert str(bag) in error


def test_bags_of_other_machines_are_refused_without_a_fault(measured):
    for bag in sorted((measured / "rosbag2_bags").glob("*/")):
        with pytest.raises(BagError, match=bag.name):
            propose_yaml(bag)
