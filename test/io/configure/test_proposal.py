# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest

from test.io.configure.test_survey import slew_valve, steps, survey, switched
from test.io.instruments import foreign_files as foreign
from valve_twin.cli import main
from valve_twin.core.diagnosis.features import ESTIMATOR as FEATURES
from valve_twin.core.types import CycleRule
from valve_twin.core.valves.registry import get_model
from valve_twin.io.bags.read import bag_info
from valve_twin.io.config.valve import load_config
from valve_twin.io.configure.channels import look
from valve_twin.io.configure.survey import choose
from valve_twin.io.instruments.clock import ClockChoice

if TYPE_CHECKING:
    from pathlib import Path


def chain(folder: Path, files, *more):
    """Run configure, import and estimate as a user does; return configuration and estimates."""
    config, bag, out = (str(folder / n) for n in ("valve.yaml", "bag", "estimates.jsonl"))
    names = [str(f) for f in files]
    assert main(["configure", *names, "--yes", "--out", config, *more]) == 0
    assert main(["import", *names, "--config", config, "--out", bag]) == 0
    main(["estimate", bag, "--config", config, "--json", out])
    lines = [json.loads(line) for line in (folder / "estimates.jsonl").read_text().splitlines()]
    estimates = [x for x in lines if x["kind"] == "estimate" and x["used_by_trend"]]
    return load_config(config)[0], estimates


def value(estimate):
    return dict(zip(estimate["names"], estimate["values"], strict=True))


@pytest.mark.no_cover
def test_the_proposal_runs_and_finds_what_the_valve_was_made_with(tmp_path, capsys):
    command = switched()
    survey(tmp_path / "a.csv", {"command [mm]": command, "stroke [mm]": slew_valve(command)})
    config, found = chain(tmp_path, [tmp_path / "a.csv"])
    assert config.cycles.rule is CycleRule.REFERENCE
    speeds = value(found[-1])
    span = 30.0  # of the stroke, that 0..1 stands for
    assert span * speeds["slew_rising"] == pytest.approx(30.0, rel=0.03)
    assert span * speeds["slew_falling"] == pytest.approx(20.0, rel=0.03)
    said = capsys.readouterr().err
    assert "models, free run on the half that was not fitted: positioner" in said
    assert len([x for x in said.splitlines() if ": " in x]) < 20
    assert (tmp_path / "valve.svg").read_text().startswith("<svg ")


@pytest.mark.no_cover
@pytest.mark.usefixtures("one_model")
def test_every_channel_lies_in_the_bag(tmp_path):
    command = steps()
    survey(tmp_path / "a.csv", {
        "cmd": command, "pos": slew_valve(command), "Öl [°C]": command + 1e-3, "öl (°c)": command,
    })  # fmt: skip
    chain(tmp_path, [tmp_path / "a.csv"])
    topics = {t.name for t in bag_info(tmp_path / "bag").topics}
    assert {"/valve/command", "/valve/position"} < topics
    assert len([t for t in topics if t.startswith("/valve/channels/")]) == 2


@pytest.mark.no_cover
@pytest.mark.usefixtures("one_model")
def test_dates_of_the_file_are_kept_and_windows_begin_with_it(tmp_path):
    foreign.tdms(tmp_path / "a.tdms")
    config, found = chain(tmp_path, [tmp_path / "a.tdms"])
    assert config.csv.base_stamp == ""
    start_ns = round(foreign.START.timestamp() * 1e9)
    assert abs(found[0]["start_ns"] - start_ns) < 5e9


KINDS = {
    "export.csv": foreign.text,
    "book.xlsx": foreign.excel,
    "v5.mat": foreign.mat5,
    "v73.mat": foreign.mat73,
    "log.tdms": foreign.tdms,
    "log.mf4": foreign.mdf,
    "log.parquet": foreign.parquet,
}


@pytest.mark.no_cover
@pytest.mark.usefixtures("one_model")
@pytest.mark.parametrize("name", KINDS)
def test_a_file_of_each_kind_ends_in_a_verdict(tmp_path, name, capsys):
    KINDS[name](tmp_path / name)
    config, found = chain(tmp_path, [tmp_path / name])
    model = get_model(config.model)
    command, answer = (config.signals[s].column for s in (model.inputs[0], model.output))
    assert command.lower().removeprefix("log.") in {"setpoint", "set point", "sollwert"}
    assert answer.lower().removeprefix("log.")[:1] in {"p", "d"}
    assert {e["file"] for e in found} == {name.partition(".")[0]}
    lines = [json.loads(x) for x in (tmp_path / "estimates.jsonl").read_text().splitlines()]
    (verdict,) = (x for x in lines if x["kind"] == "verdict")
    assert verdict["evidence"]
    assert FEATURES in {x.get("estimator") for x in lines}
    assert "service limits, outside the scatter: none set" in capsys.readouterr().err
    page, rows = tmp_path / "r.html", tmp_path / "p.csv"
    given = [str(tmp_path / "bag"), "--config", str(tmp_path / "valve.yaml")]
    assert main(["report", *given, "--out", str(page)]) == 0
    assert "Recordings</h2>" in page.read_text()
    assert main(["predict", *given, "--out", str(rows)]) == (0 if len(found) > 2 else 1)
    predicted = "no cycle could be predicted" not in capsys.readouterr().err
    assert predicted == (len(found) > 2)


def test_a_bad_file_among_several_is_left_out_of_the_bag(tmp_path, capsys):
    for name in "ac":
        survey(tmp_path / f"{name}.csv", {"stroke": slew_valve(switched())})
    (tmp_path / "b.csv").write_text("t_s,cmd\n1,2\n2,3\n3,4\n", encoding="utf-8")
    chain(tmp_path, [tmp_path / f"{x}.csv" for x in "abc"])
    said = capsys.readouterr().err
    assert "left out: " in said
    assert "2 files" in said
    assert bag_info(tmp_path / "bag").custom["imported_files"] == "2"


@pytest.mark.usefixtures("one_model")
def test_a_model_worse_than_the_mean_is_shown_and_not_proposed(tmp_path, capsys):
    """The lever of a flap slips in the middle of the record."""
    command = steps()
    flap = 0.6 * slew_valve(command)
    flap += np.interp(np.arange(len(flap)), [0.4 * len(flap), 0.7 * len(flap)], [0.0, 60.0])
    survey(tmp_path / "a.csv", {"set point [mm]": command, "flap position [mm]": flap})
    out = tmp_path / "v.yaml"
    assert main(["configure", str(tmp_path / "a.csv"), "--yes", "--out", str(out)]) == 1
    said = capsys.readouterr().err
    assert "models, free run on the half that was not fitted: first_order -" in said
    (told,) = (x for x in said.splitlines() if "nothing is proposed" in x)
    assert "worse than its mean does (free run -" in told
    assert "record steps of several sizes" in told
    assert not out.exists()
    assert (tmp_path / "v.svg").read_text().startswith("<svg ")


def test_invented_times_are_said_everywhere(tmp_path, capsys):
    text = "stroke\n" + "".join(f"{x:.4f}\n" for x in slew_valve(switched()))
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    file = str(tmp_path / "a.csv")
    assert main(["configure", file, "--yes", "--out", str(tmp_path / "v.yaml")]) == 0
    assert "NOT MEASURED" in capsys.readouterr().err
    assert "NOT MEASURED" in (tmp_path / "v.yaml").read_text()
    assert not load_config(tmp_path / "v.yaml")[0].csv.times_measured
    given = ["--config", str(tmp_path / "v.yaml")]
    bag, page = str(tmp_path / "bag"), tmp_path / "r.html"
    assert main(["import", file, *given, "--out", bag]) == 0
    assert main(["report", bag, *given, "--out", str(page)]) == 0
    assert "NOT MEASURED" in capsys.readouterr().err
    assert "<b>Times are NOT MEASURED" in page.read_text()
    assert ">sample<" in (tmp_path / "v.svg").read_text()
    assert main(["configure", file, "--period", "0.02", "--out", str(tmp_path / "v.yaml")]) == 0
    config = load_config(tmp_path / "v.yaml")[0]
    assert config.period_s == pytest.approx(0.02)
    assert config.csv.times_measured


@pytest.mark.parametrize(("answer", "period_s"), [("\n", 1.0), ("0.02\n", 0.02)])
def test_one_question_with_a_default_is_asked(tmp_path, monkeypatch, answer, period_s):
    text = "stroke\n" + "".join(f"{x:.4f}\n" for x in slew_valve(switched()))
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")

    class Terminal:
        def __init__(self) -> None:
            self.asked = 0

        def isatty(self):
            return True

        def readline(self):
            self.asked += 1
            return answer

    terminal = Terminal()
    monkeypatch.setattr(sys, "stdin", terminal)
    out = tmp_path / "v.yaml"
    assert main(["configure", str(tmp_path / "a.csv"), "--out", str(out)]) == 0
    assert terminal.asked == 1
    assert load_config(out)[0].period_s == pytest.approx(period_s)


def test_strokes_without_a_command_give_timing_and_no_verdict(tmp_path):
    survey(tmp_path / "a.csv", {"stroke [mm]": slew_valve(switched())})
    config, found = chain(tmp_path, [tmp_path / "a.csv"])
    assert len(found) == 6
    assert "no command recorded" in config.aging.label


def test_strokes_without_a_command_are_cut_alike_over_many_files(tmp_path):
    rng = np.random.default_rng(5)
    stroke = slew_valve(np.repeat([5.0, 35.0, 20.0, 5.0], [50, 100, 100, 150]), seed=3)
    for k in range(12):
        values = stroke + rng.normal(0.0, 0.02, len(stroke))
        survey(tmp_path / f"run_{k:02d}.csv", {"stroke [mm]": values})
    _, found = chain(tmp_path, sorted(tmp_path.glob("run_*.csv")))
    assert [e["file"] for e in found[:-1]] == [f"run_{k:02d}" for k in range(11)]
    assert all(e["status"] != "REFUSED" for e in found[:-1])


def test_a_cycle_in_counted_rows_is_not_told_as_measured_seconds(tmp_path):
    found = survey(tmp_path / "a.csv", {"stroke [mm]": slew_valve(switched())})
    counted = tmp_path / "b.csv"
    lines = (tmp_path / "a.csv").read_text(encoding="utf-8").splitlines()
    counted.write_text("\n".join(line.split(",")[1] for line in lines), encoding="utf-8")
    assert "NOT MEASURED" not in choose(found)[1].plan.reason
    assert "NOT MEASURED" in choose(look([counted], ClockChoice()))[1].plan.reason


def test_the_rig_gives_what_its_own_configuration_gives(root, measured, tmp_path):
    (file,) = (measured / "zema_hydraulic_rig").glob("fs1*.gz")
    _, found = chain(tmp_path, [file], "--period", "0.1")
    assert len(found) == 103
    instants = [value(e)["switching_instant"] for e in found]
    profile = np.loadtxt(measured / "zema_hydraulic_rig" / "profile_cycles_0_102.txt")
    lags = [np.mean(np.array(instants)[profile[:, 1] == level]) for level in (100, 90, 80, 73)]
    assert np.all(np.diff(lags) > 0.02)


@pytest.mark.no_cover
def test_the_crane_is_followed_over_its_second_half(measured, tmp_path):
    _, found = chain(tmp_path, [measured / "hydraulic_actuator" / "actuator.csv"])
    assert [e["model"] for e in found] == ["hydraulic_actuator"] * 2
    assert found[1]["fit_test"] > 60.0


@pytest.mark.no_cover
def test_the_pilot_valve_is_followed_by_the_model_of_the_steps_before(shared, tmp_path):
    files = sorted((shared / "eppr_excavator").glob("arm_in_0[5-9]0_HC.csv.gz"))
    config, found = chain(tmp_path, files)
    assert config.signals["command"].column == "duty_pct"
    assert config.signals["position"].column == "pilot_pressure_bar"
    tested = [e["fit_test"] for e in found if e["fit_test"] is not None]
    assert np.median(tested) > 80.0
