# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The offline command: every verb on real files; every refusal one line with place and remedy."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest

from test.bag_samples import write_sample
from valve_twin.cli import main
from valve_twin.cli.design.verb import STEPS
from valve_twin.cli.main import VERBS
from valve_twin.core.operation.counters import Counters
from valve_twin.core.operation.events import Event
from valve_twin.core.types import Maintenance
from valve_twin.io.bags.read import BagWriter
from valve_twin.io.config.valve import load_config
from valve_twin.io.history.store import History
from valve_twin.io.offline.run import run_bag

if TYPE_CHECKING:
    from pathlib import Path

CYCLES = 4
OK, FAILED, USAGE = 0, 1, 2
VALVE = "/press/valve_1"
POSITION = f"/sim{VALVE}/spool_position"
ROWS = "time,command,position\n" + "".join(
    f"{n * 0.1:.1f},{(n // 50) % 2 * 50},{(n // 50) % 2 * 49}\n" for n in range(400)
)
CSV_CONFIG = """\
/**:
  ros__parameters:
    model: positioner
    period_s: 0.1
    signals:
      command: {topic: command, column: command, scale: 0.01}
      position: {topic: position, column: position, scale: 0.01}
    cycles: {rule: window, window_s: 20.0}
    csv: {time_column: time, base_stamp: "2020-01-01T00:00:00Z"}
"""


def call(*arguments: object) -> int:
    """Run the command in this process and return its exit code."""
    try:
        return main([str(a) for a in arguments])
    except SystemExit as end:
        return int(str(end.code))


@pytest.fixture(scope="module")
def press(tmp_path_factory, root):
    """Return a recorded press valve, its configuration and a folder."""
    folder = tmp_path_factory.mktemp("cli")
    config, bag = root / "config" / "simulated_press.yaml", folder / "bag"
    assert call("simulate", "--config", config, "--cycles", CYCLES, "--out", bag) == OK
    return SimpleNamespace(folder=folder, config=config, bag=bag)


@pytest.fixture
def edited(press, tmp_path):
    """Return a function that writes the configuration with one text replaced."""

    def edit(old: str, new: str) -> Path:
        text = press.config.read_text(encoding="utf-8")
        assert old in text
        path: Path = tmp_path / "edited.yaml"
        path.write_text(text.replace(old, new, 1), encoding="utf-8")
        return path

    return edit


@pytest.fixture
def refused(capsys):
    """Return a function that runs the command and checks the one line of its refusal."""

    def refuse(code: int, parts: tuple[object, ...], *arguments: object) -> None:
        capsys.readouterr()
        assert call(*arguments) == code
        out, err = capsys.readouterr()
        assert out == ""
        assert err.count("\n") == 1
        assert err.startswith("valve-twin")
        for part in parts:
            assert str(part) in err

    return refuse


# -- the verbs


def test_simulate_says_what_it_wrote(press, tmp_path, capsys):
    bag = tmp_path / "bag"
    assert call("simulate", "--config", press.config, "--cycles", 1, "--out", bag) == OK
    assert capsys.readouterr().err == f"{bag}: 1 cycles, 2550 messages\n"
    assert (bag / "metadata.yaml").is_file()


def test_simulate_gives_the_same_bytes_for_the_same_seed(press, tmp_path):
    for name, seed in (("a", 5), ("b", 5), ("c", 6)):
        folder = tmp_path / name / "bag"
        folder.parent.mkdir()
        arguments = ("--cycles", 1, "--seed", seed, "--out", folder)
        assert call("simulate", "--config", press.config, *arguments) == OK
    a, b, c = ((tmp_path / name / "bag" / "bag_0.mcap").read_bytes() for name in "abc")
    assert a == b
    assert a != c


@pytest.mark.parametrize("value", ["1e-3", "0.001", "1.0E-3"])
def test_set_reads_a_number_in_any_notation(press, tmp_path, value):
    setting = f"measurement.noise={value}"
    out = tmp_path / "bag"
    arguments = ("--cycles", 1, "--out", out, "--set", setting)
    assert call("simulate", "--config", press.config, *arguments) == OK


def test_estimate_prints_estimates_trends_and_the_verdict(press, capsys):
    assert call("estimate", press.bag, "--config", press.config) == OK
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    kinds = [line["kind"] for line in lines]
    order = ["estimate", "trend", "verdict", "advice", "counters", "baseline"]
    assert kinds == sorted(kinds, key=order.index)
    assert [x["cycle"] for x in lines if x.get("estimator") == "output_error"] == [1, 2, 3, 4]
    assert kinds.count("trend") >= 2
    assert kinds.count("verdict") == 1


def test_estimate_writes_the_same_file_that_it_prints(press, tmp_path, capsys):
    out = tmp_path / "lines.jsonl"
    assert call("estimate", press.bag, "--config", press.config) == OK
    printed = capsys.readouterr().out
    assert call("estimate", press.bag, "--config", press.config, "--json", out) == OK
    assert out.read_text(encoding="utf-8") == printed
    told = capsys.readouterr().err
    assert told.startswith(f"{out}: {CYCLES} cycles; ")


def test_closed_cycles_only_leaves_out_the_cycle_in_which_the_record_ends(press, capsys):
    arguments = ("estimate", press.bag, "--config", press.config, "--closed-cycles-only")
    assert call(*arguments) == OK
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {x["cycle"] for x in lines if x["kind"] == "estimate"} == {1, 2, 3}


def test_report_writes_one_page(press, tmp_path, capsys):
    page = tmp_path / "page.html"
    assert call("report", press.bag, "--config", press.config, "--out", page) == OK
    assert capsys.readouterr().err == f"{page}: written\n"
    text = page.read_text(encoding="utf-8")
    assert VALVE in text
    assert "http://" not in text.replace("http://www.w3.org/", "")


def test_the_proposal_for_a_bag_estimates_that_bag(press, tmp_path, capsys):
    proposal = tmp_path / "proposal.yaml"
    assert call("configure", press.bag, "--out", proposal) == OK
    assert "check it before you use it" in capsys.readouterr().err
    assert call("estimate", press.bag, "--config", proposal) == OK
    assert capsys.readouterr().out.count('"estimator": "output_error"') == CYCLES


def test_import_makes_a_bag_that_can_be_estimated(tmp_path, capsys):
    table, config, bag = tmp_path / "a.csv", tmp_path / "c.yaml", tmp_path / "bag"
    table.write_text(ROWS, encoding="utf-8")
    config.write_text(CSV_CONFIG, encoding="utf-8")
    assert call("import", table, "--config", config, "--out", bag) == OK
    assert "400 rows" in capsys.readouterr().err
    assert call("estimate", bag, "--config", config) == OK
    assert capsys.readouterr().out.count('"kind": "estimate"') == 2


@pytest.fixture(scope="module")
def stored(press):
    """Return a history of the recorded valve."""
    path = press.folder / "history.sqlite"
    (config,) = load_config(press.config)
    record = run_bag(config, press.bag)
    with History(path) as history:
        for cycle in record.cycles:
            own = [e for e in record.estimates if e.cycle == cycle.cycle]
            history.store(config.name, cycle, own)
    return path


def test_history_lists_its_valves(stored, capsys):
    assert call("history", "list", "--url", stored) == OK
    assert capsys.readouterr().out == f"{VALVE}: last cycle {CYCLES}\n"


def test_a_backup_of_the_history_holds_what_it_holds(stored, tmp_path, capsys):
    copy = tmp_path / "copy.sqlite"
    assert call("history", "backup", "--url", stored, "--out", copy) == OK
    assert str(copy) in capsys.readouterr().err
    with History(stored, read_only=True) as one, History(copy, read_only=True) as other:
        assert repr(one.estimates(VALVE)) == repr(other.estimates(VALVE)) != "[]"


def test_an_export_of_the_history_names_its_files(stored, tmp_path, capsys):
    assert call("history", "export", "--url", stored, "--out", tmp_path / "out") == OK
    told = capsys.readouterr().err
    for name in ("cycles.csv", "estimates.csv", "maintenance.csv", "history.jsonl"):
        assert (tmp_path / "out" / name).is_file()
        assert f"{tmp_path / 'out' / name}: written" in told


@pytest.fixture
def marked(stored, tmp_path):
    """Return a copy of the stored history with a maintenance event."""
    path = tmp_path / "marked.sqlite"
    with History(stored, read_only=True) as history:
        history.backup(path)
    with History(path) as history:
        history.add_maintenance(VALVE, Maintenance(6, 3, "new pilot"))
    return path


def test_a_maintenance_event_is_withdrawn_without_ros(marked, capsys):
    with History(marked) as history:
        history.add_maintenance(VALVE, Maintenance(5, 2, "new\nseal", new_reference=True))
    withdraw = ("history", "withdraw", "--url", marked, "--note", "it was valve 2")
    assert call(*withdraw, "--valve", VALVE, "--cycle", 2) == OK
    assert f"{VALVE}: the event at cycle 2 ('new\\nseal') is withdrawn" in capsys.readouterr().err
    assert call("history", "maintenance", "--url", marked) == OK
    assert capsys.readouterr().out == (
        f"{VALVE}: cycle 2: 'new\\nseal', withdrawn: 'it was valve 2'\n"
        f"{VALVE}: cycle 3: 'new pilot', begins a new segment\n"
    )
    assert call("history", "verify", "--url", marked) == OK


@pytest.mark.parametrize(
    ("code", "arguments", "parts"),
    [
        (FAILED, ("--cycle", 2), ("cycle 2 is not there", "in force are those at cycle 3")),
        (FAILED, ("--cycle", 3, "--note", " "), ("the note is empty",)),
        (FAILED, ("--cycle", 3, "--note", "x" * 2049), ("2049 bytes, 2048 at most",)),
        (USAGE, (), ("--cycle is missing",)),
        (USAGE, ("--cycle", 0), ("--cycle",)),
        (USAGE, ("--cycle", 3, "--valve", "/press/valve_9"), ("no valve '/press/valve_9'", VALVE)),
    ],
)
def test_a_withdrawal_that_makes_no_sense_is_refused(code, arguments, parts, marked, refused):
    refused(code, parts, "history", "withdraw", "--url", marked, "--note", "why", *arguments)
    with History(marked, read_only=True) as history:
        assert not history.maintenance(VALVE)[0].withdrawn


def test_a_history_in_use_is_left_to_its_twin(marked, refused):
    with History(marked) as history:
        history.claim(VALVE)
        told = ("is already written", f"{VALVE}/twin/withdraw_maintenance")
        withdraw = ("withdraw", "--url", marked, "--note", "why", "--cycle", 3)
        refused(FAILED, told, "history", *withdraw)
        assert not history.maintenance(VALVE)[0].withdrawn


def test_report_without_a_bag_shows_the_history(stored, edited, tmp_path):
    config = edited("model:", f"history_url: sqlite:///{stored}\n    model:")
    page = tmp_path / "page.html"
    assert call("report", "--config", config, "--out", page) == OK
    assert stored.name in page.read_text(encoding="utf-8")


def test_help_of_every_verb_is_printed(capsys):
    steps = [("design", *named(step)) for step in STEPS]
    for verb in [(verb,) for verb in VERBS if verb != "design"] + steps:
        assert call(*verb, "--help") == OK
        assert " ".join(("valve-twin", *verb)) in capsys.readouterr().out


ALONE = """
import sys
from contextlib import suppress
from valve_twin.cli import main

with suppress(SystemExit):
    main(["info", "--help"])
print(*(name for name in sys.modules if name.startswith("valve_twin.cli.")))
"""


def test_a_verb_is_read_without_the_others():
    command = [sys.executable, "-c", ALONE]
    told = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    rooms = {name.split(".")[2] for name in told.splitlines()[-1].split()}
    assert rooms == {"main", "common", "output", "bags"}


def named(module):
    """Return the verb or step of a module."""
    return (module.__name__.rpartition(".")[2].strip("_").replace("_", "-"),)


# -- wrong usage


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        ((), ("VERB", "valve-twin --help")),
        (("estimat",), ("estimat", "estimate", "valve-twin --help")),
        (("estimate", "bag"), ("--config", "valve-twin estimate --help")),
        (("report", "--config", "c.yaml"), ("--out", "valve-twin report --help")),
        (("configure", "bag", "--colour", "red"), ("--colour red", "--help")),
        (("history", "drop", "--url", "a"), ("drop", "backup", "valve-twin history --help")),
        (("replay", "bag", "--rate", "-1"), ("--rate", "'-1'", "0 or more")),
        (("replay", "bag", "--rate", "nan"), ("--rate", "'nan'", "0 or more")),
    ],
)
def test_wrong_usage_is_told_with_what_to_write(refused, arguments, parts):
    refused(USAGE, parts, *arguments)


@pytest.mark.parametrize(
    ("more", "parts"),
    [
        (("--cycles", "0"), ("--cycles", "'0'", "1 or more")),
        (("--cycles", "many"), ("--cycles", "'many'", "whole number")),
        (("--seed", "-1"), ("--seed", "'-1'", "0 or more")),
        (("--set", "noise"), ("--set noise", "NAME=VALUE")),
        (("--set", "measurement.nois=1"), ("measurement.nois", "'measurement.noise'")),
        (("--set", "measurement.noise=loud"), ("measurement.noise", "'loud'", "number")),
        (("--set", "measurement.noise=-1"), ("noise", "-1", "0 to 1")),
        (("--set", "measurement.noise=["), ("measurement.noise", "'['", "write a number")),
        (("--set", "aging.area_i.rate=1"), ("area_i", "did you mean 'area_in'?")),
        (("--valve", "press/valve_2"), ("/press/valve_2", VALVE)),
    ],
)
def test_a_wrong_setting_of_the_simulation_is_told(refused, press, tmp_path, more, parts):
    out = tmp_path / "bag"
    refused(USAGE, parts, "simulate", "--config", press.config, "--out", out, *more)
    assert not out.exists()


# -- the configuration


def test_a_missing_configuration_is_named(refused, press):
    parts = ("nowhere.yaml", "no such file", "give the path")
    refused(USAGE, parts, "estimate", press.bag, "--config", "nowhere.yaml")


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("period_s:", "periods:", ("key 'periods'", "did you mean 'period_s'?")),
        ("rule: commands", "rules: commands", ("cycles.rules", "did you mean 'cycles.rule'?")),
        ("rule: commands", "rule: command", ("cycles.rule", "'command'", "commands")),
        (
            "press_cartridge ",
            "press_cartrige ",
            ("key 'model'", "press_cartrige", "press_cartridge"),
        ),
        ("period_s: 0.03", "period_s: -0.03", ("key 'period_s'", "-0.03")),
        ("period_s: 0.03", "period_s: fast", ("key 'period_s'", "fast")),
        ("start_signal: v_in", "start_signal: v_i", ("v_i", "v_in")),
        ("  ros__parameters:", "  ros_parameters:", ("ros__parameters",)),
        ("/**:", "/**: [", ("YAML", "line")),
    ],
)
def test_a_wrong_key_or_value_is_named_with_file_and_remedy(
    refused, press, edited, old, new, parts
):
    config = edited(old, new)
    arguments = ("estimate", press.bag, "--config", config)
    where = () if new == "start_signal: v_i" else (config,)
    refused(USAGE, (*where, *parts), *arguments)


def test_a_whole_number_is_taken_where_a_float_belongs(press, edited, capsys):
    config = edited("rule: commands", "min_cycle_s: 2\n      rule: commands")
    assert call("estimate", press.bag, "--config", config) == OK
    assert '"kind": "estimate"' in capsys.readouterr().out


# -- the bag


def test_a_missing_topic_is_named_with_the_nearest_one(refused, press, edited):
    config = edited("topic: spool_position", "topic: spool_positon")
    nearest = f"did you mean '{POSITION}'?"
    parts = (press.bag, "spool_positon'", "not in the bag", nearest)
    refused(FAILED, parts, "estimate", press.bag, "--config", config)


def test_another_message_type_is_named_with_the_line_to_write(refused, press, edited):
    other = "topic: spool_position\n        type: std_msgs/msg/Float64\n        field: data"
    config = edited("topic: spool_position", other)
    written = "valve_twin_msgs/msg/Float64Stamped"
    parts = (POSITION, "std_msgs/msg/Float64", f"write signals.spool_position.type: {written}")
    refused(FAILED, parts, "estimate", press.bag, "--config", config)


def test_a_field_that_is_not_in_the_message_is_named(refused, press, edited):
    config = edited("topic: spool_position", "topic: spool_position\n        field: valu")
    parts = ("field 'valu'", "did you mean 'value'?")
    refused(USAGE, parts, "estimate", press.bag, "--config", config)


def test_a_bag_without_messages_is_told(refused, press, tmp_path):
    bag = tmp_path / "empty"
    with BagWriter(bag) as writer:
        for topic in ("command/v_in", "command/v_out", "spool_position"):
            writer.add_topic(f"/sim{VALVE}/{topic}", "valve_twin_msgs/msg/Float64Stamped")
    parts = (bag, "has no messages", "check that its publisher ran")
    refused(FAILED, parts, "estimate", bag, "--config", press.config)


def test_a_bag_of_something_else_is_told_with_what_it_holds(refused, press, tmp_path):
    bag = tmp_path / "foreign"
    with BagWriter(bag) as writer:
        write_sample(writer, "/robot/joint", 10**18, 1.0)
    parts = (bag, "not in the bag", "/robot/joint")
    refused(FAILED, parts, "estimate", bag, "--config", press.config)


def test_what_is_no_bag_is_told(refused, press, tmp_path):
    text = tmp_path / "notes.mcap"
    text.write_text("not a bag", encoding="utf-8")
    for path, part in ((text, "no MCAP file"), (tmp_path / "gone", "no such file")):
        refused(FAILED, (path, part, "give a"), "estimate", path, "--config", press.config)
        refused(FAILED, (path, part, "give a"), "configure", path)


def test_what_is_intact_of_a_bag_cut_short_is_estimated_and_the_loss_told(press, tmp_path, capsys):
    (whole,) = press.bag.glob("*.mcap")
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    capsys.readouterr()
    assert call("estimate", whole, "--config", press.config) == OK
    command = [sys.executable, "-m", "valve_twin.cli", "estimate", str(cut)]
    command += ["--config", str(press.config)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert f"{cut}: byte " in done.stderr
    assert "the file ends in it" in done.stderr
    assert "lost: " in done.stderr
    of_all, intact = (
        [x for x in map(json.loads, text.splitlines()) if x.get("cycle") == 1 and "estimator" in x]
        for text in (capsys.readouterr().out, done.stdout)
    )
    assert intact
    assert intact == of_all


def test_a_record_without_a_cycle_is_told_with_its_rule(refused, press, tmp_path):
    bag, page = tmp_path / "rest", tmp_path / "page.html"
    with BagWriter(bag) as writer:
        for n in range(100):
            for topic in ("command/v_in", "command/v_out", "spool_position"):
                write_sample(writer, f"/sim{VALVE}/{topic}", 10**18 + n * 30_000_000, 0.0)
    parts = (bag, "no cycle", "rule 'commands'", "valve-twin configure")
    refused(FAILED, parts, "report", bag, "--config", press.config, "--out", page)
    assert not page.exists()
    lines = tmp_path / "lines.jsonl"
    assert call("estimate", bag, "--config", press.config, "--json", lines) == FAILED


# -- files that cannot be written


def test_an_existing_bag_is_not_overwritten(refused, press):
    before = sorted((p.name, p.stat().st_mtime_ns) for p in press.bag.iterdir())
    parts = (press.bag, "exists already", "give a new folder")
    refused(FAILED, parts, "simulate", "--config", press.config, "--out", press.bag)
    assert sorted((p.name, p.stat().st_mtime_ns) for p in press.bag.iterdir()) == before


def test_a_result_that_cannot_be_written_is_named(refused, press, tmp_path):
    gone = tmp_path / "gone" / "out"
    with_config = ("--config", press.config)
    parts = (gone, "check the folder")
    refused(FAILED, parts, "estimate", press.bag, *with_config, "--json", gone)
    refused(FAILED, parts, "report", press.bag, *with_config, "--out", gone)
    refused(FAILED, parts, "configure", press.bag, "--out", gone)
    refused(FAILED, (tmp_path,), "estimate", press.bag, *with_config, "--json", tmp_path)


def test_a_history_that_is_none_is_named(refused, press, tmp_path):
    gone = tmp_path / "gone.sqlite"
    refused(FAILED, (gone, "no such file", "check"), "history", "list", "--url", gone)
    text = tmp_path / "notes.txt"
    text.write_text("not a database, but long enough to be read as one" * 40, encoding="utf-8")
    refused(FAILED, (text, "no SQLite database"), "history", "list", "--url", text)
    assert not gone.exists()


# -- the process


def run(code: str, *arguments: object, **kwargs) -> subprocess.CompletedProcess[str]:
    """Run Python in a process of its own."""
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=60, check=False, **kwargs
    )


WITHOUT_ROS = """\
import sys
sys.modules["rclpy"] = None
from valve_twin.cli import main
sys.exit(main(sys.argv[1:]))
"""


def test_replay_without_ros_says_what_else_to_do(press):
    done = run(WITHOUT_ROS, "replay", press.bag)
    assert done.returncode == FAILED
    assert done.stderr.count("\n") == 1
    for part in ("replay needs ROS 2", "rclpy", "tools/run", "estimate offline"):
        assert part in done.stderr


def test_offline_verbs_need_no_ros(press):
    done = run(WITHOUT_ROS, "estimate", press.bag, "--config", press.config)
    assert (done.returncode, done.stderr) == (OK, "")
    assert done.stdout.count('"estimator": "output_error"') == CYCLES


@pytest.mark.parametrize("prints", ["lines", "a table"])
def test_a_reader_that_has_seen_enough_is_no_error(press, prints):
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "valve_twin.cli"]
    if prints == "lines":
        command += ["estimate", str(press.bag), "--config", str(press.config)]
    else:
        command.append("bench-fit")
    with os.fdopen(writing, "wb") as out:
        done = subprocess.run(command, stdout=out, stderr=subprocess.PIPE, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (OK, b"")


def test_history_tells_counters_and_events_and_takes_acknowledgements(stored, capsys):
    with History(stored) as history:
        (valve,) = history.valves()
        last = history.cycles(valve)[-1]
        following = replace(last, cycle=last.cycle + 1)
        history.store(valve, following, (), Counters(cycle=following.cycle, cycles=7, reversals=3))
        fault = Event(10**18, 5, "fault.sensor_freeze", "failure", "frozen\n[red]")
        history.log.add(valve, fault)
    assert call("history", "counters", "--url", stored) == OK
    assert ": 7 cycles, 3 movements, 3 reversals" in capsys.readouterr().out
    assert call("history", "counters", "--url", stored, "--json") == OK
    assert json.loads(capsys.readouterr().out)["cycles"] == 7
    assert call("history", "events", "--url", stored, "--open") == OK
    out = capsys.readouterr().out
    assert out.count("\n") == 1
    assert "2001-09-09" in out
    assert "fault.sensor_freeze (failure, open): 'frozen\\n[red]'" in out
    assert call("history", "acknowledge", "--url", stored) == FAILED
    assert "who is empty" in capsys.readouterr().err
    assert call("history", "acknowledge", "--url", stored, "--who", "me") == OK
    assert call("history", "events", "--url", stored, "--open", "--json") == OK
    assert capsys.readouterr().out == ""
