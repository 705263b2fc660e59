# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin stroke-test`: a stroke of a file, its verdict as exit code, refusals in a line."""

import json

import pytest

from valve_twin.cli import main
from valve_twin.core.aging.config import AgingConfig
from valve_twin.io.config.valve import load_config
from valve_twin.io.history.fleet import rank_fleet
from valve_twin.io.history.store import CycleRecord, History
from valve_twin.report.build import history_data
from valve_twin.report.page import render_report

CONFIG = """\
/**:
  ros__parameters:
    model: positioner
    period_s: 0.05
    signals:
      command: {topic: command, column: command, scale: 0.01}
      position: {topic: position, column: position, scale: 0.01}
    csv: {time_column: time, base_stamp: "2020-01-01T00:00:00Z"}
"""


@pytest.fixture
def run(tmp_path, capsys):
    """Return a function that imports a stroke and judges it: exit code, output, errors."""
    config = tmp_path / "valve.yaml"
    config.write_text(CONFIG, encoding="utf-8")

    def judge(reach, *arguments, step=20.0):
        rows = ["time,command,position"]
        position = 100.0
        for n in range(600):
            command = 100.0 - step if 100 <= n < 350 else 100.0
            goal = 100.0 - step * reach if 110 <= n < 360 else 100.0
            position += max(min(goal - position, 0.5), -0.5)
            rows.append(f"{n * 0.05:.2f},{command},{position + 0.02 * (-1) ** n}")
        source = tmp_path / "rows.csv"
        source.write_text("\n".join(rows) + "\n", encoding="utf-8")
        bag = tmp_path / f"bag{len(list(tmp_path.glob('bag*')))}"
        named = ["--config", str(config)]
        assert main(["import", str(source), *named, "--out", str(bag)]) == 0
        capsys.readouterr()
        code = main(["stroke-test", str(bag), *named, *arguments])
        return code, *capsys.readouterr()

    return judge


def test_a_partial_stroke_passes(run):
    code, out, err = run(1.0)
    assert (code, err) == (0, "")
    assert out.splitlines()[-1] == "pass"
    assert out.splitlines()[0].startswith("breakaway_s")


def test_a_stuck_valve_fails_and_says_by_how_much(run):
    code, out, _ = run(0.0, "--json")
    found = json.loads(out)
    assert (code, found["verdict"]) == (1, "fail")
    assert found["stroke"] == pytest.approx(0.2)
    criteria = {c["name"]: c for c in found["criteria"]}
    assert criteria["t63_s"]["value"] == "Infinity"
    assert criteria["travel"]["excess"] == pytest.approx(0.95, abs=0.01)


def test_a_limit_can_be_set(run):
    code, out, _ = run(1.0, "--set", "t86_s=1")
    assert code == 1
    (line,) = (line for line in out.splitlines() if "not kept" in line)
    assert line.startswith("t86_s ")


def test_a_test_is_taken_down_once_in_the_event_log_and_fleet_tells_when_the_next_is_due(
    run, tmp_path, capsys
):
    url, name = str(tmp_path / "history.sqlite"), load_config(str(tmp_path / "valve.yaml"))[0].name
    code, _, err = run(1.0, "--url", url)
    assert (code, err.count("\n")) == (1, 1)
    assert "there is no such file" in err
    assert not (tmp_path / "history.sqlite").exists()
    began_s = 1_577_836_800  # 2020-01-01
    end_ns = (began_s + 10 * 86_400) * 10**9
    with History(url) as history:
        history.store(name, CycleRecord(1, end_ns - 10, end_ns, 10))
    for reach, wanted in ((1.0, 0), (1.0, 0), (0.0, 1)):
        assert run(reach, "--url", url)[0] == wanted
    with History(url, read_only=True) as history:
        assert [e.code for e in history.log.events(name)] == [
            "stroke_test.pass",
            "stroke_test.fail",
        ]
        page = render_report(history_data(history, name, AgingConfig(stroke_test_days=7.0)))
        (row,) = rank_fleet(history, aging={name: AgingConfig(stroke_test_days=30.0)})
    assert "10.0 days ago, overdue by 3.0 days" in page
    assert row.stroke_test == "fail"
    assert row.stroke_days_since == pytest.approx(10.0)
    assert row.stroke_days_until == pytest.approx(20.0)
    assert main(["fleet", "--url", url]) == 0
    assert f"{name}: stroke test fail, 10.0 days ago" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "step", "code", "part"),
    [
        (("--set", "t68_s=1"), 20.0, 2, "t68_s: no such limit; did you mean 't"),
        (("--set", "travel=0.9"), 20.0, 2, "is outside its limits"),
        (("--set", "travel"), 20.0, 2, "is no number; write for example"),
        ((), 0.5, 1, "too small beside the noise"),
        ((), 0.0, 1, "no stroke was commanded"),
    ],
)
def test_what_cannot_be_judged_is_one_line(run, arguments, step, code, part):
    found, out, err = run(1.0, *arguments, step=step)
    assert (found, out, err.count("\n")) == (code, "", 1)
    assert part in err
