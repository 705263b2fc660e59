# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin stroke-test`: a stroke of a file, its verdict as exit code, refusals in a line."""

import json

import pytest

from valve_twin.cli import main

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
        bag = tmp_path / "bag"
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
