# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Limit switches and a command: an on/off drive with a spring, of another hand, gives timing."""

import json

import numpy as np
import pytest

from test.io.configure.test_proposal import chain, value
from test.io.configure.test_survey import STEP_S, survey
from valve_twin.cli import main
from valve_twin.core.types import CycleRule
from valve_twin.io.configure import switches
from valve_twin.io.configure.switches import find_switches

CYCLES = 12


def drive(*, slower=0.0, seed=1):
    """Return command, open and closed of a drive: a pressure fills, a spring turns back.

    It breaks away at 0.3 of its supply, moves by what is above, and fills `slower` by the end.
    """
    random = np.random.default_rng(seed)
    pressure, x, rows = 0.0, 0.0, []
    for n in range(CYCLES):
        fills = 0.3 * (1.0 + slower * (n >= CYCLES // 2))
        held = 150 + int(random.integers(0, 40))
        for on in [1.0] * held + [0.0] * 160:
            pressure += STEP_S / (fills if on else 0.4) * (on - pressure)
            speed = pressure - 0.3 if on else min(pressure - 0.4, 0.0)
            x = min(max(x + STEP_S * 2.5 * (speed if on or x > 0.0 else 0.0), 0.0), 1.0)
            rows.append((on, float(x >= 0.98), float(x <= 0.02)))
    return np.array(rows)


def columns(rows):
    """Return them beside a pressure, which is no answer."""
    air = 6.0 + 0.02 * np.random.default_rng(5).standard_normal(len(rows))
    names = ("Endlage Zu", "Endlage Auf", "Druck [bar]", "Befehl Auf")
    return dict(zip(names, (rows[:, 2], rows[:, 1], air, rows[:, 0]), strict=True))


def times(rows):
    """Return dead and stroke times of the openings [s]."""
    asked = np.flatnonzero(np.diff(rows[:, 0]) > 0.0) + 1
    leaves = [a + int(np.argmin(rows[a:, 2])) for a in asked]
    arrives = [a + int(np.argmax(rows[a:, 1])) for a in asked]
    return STEP_S * (leaves - asked), STEP_S * (np.array(arrives) - leaves)


def test_limit_switches_alone_give_dead_and_stroke_time(tmp_path, capsys):
    rows = drive(slower=0.5)
    survey(tmp_path / "a.csv", columns(rows))
    config, found = chain(tmp_path, [tmp_path / "a.csv"])
    assert (config.model, config.cycles.rule) == ("cycle_timing", CycleRule.REFERENCE)
    dead, stroke = times(rows)
    told = [value(e) for e in found if e["cycle"] > 1]  # the record begins with the command
    late = [t["rise_instant"] for t in told]
    assert late == pytest.approx(dead[-len(late) :], abs=STEP_S)
    assert [t["decay"] for t in told] == pytest.approx(stroke[-len(late) :], abs=2.0 * STEP_S)
    assert told[-1]["valve_lag"] - told[0]["valve_lag"] > 2.0 * STEP_S
    assert "rise_instant is the dead time" in capsys.readouterr().err


@pytest.mark.parametrize("wrong", ["a position", "no command", "both ends"])
def test_it_is_not_taken_for_limit_switches_what_is_none(tmp_path, wrong):
    rows = drive()
    given = columns(rows)
    if wrong == "a position":
        given["valve position [%]"] = 100.0 * np.convolve(rows[:, 0], np.ones(9) / 9.0, "same")
    elif wrong == "no command":
        del given["Befehl Auf"]
    else:
        given["Endlage Zu"] = 1.0 - 0.5 * (np.arange(len(rows)) % 100 < 60) * 2.0
    assert find_switches(survey(tmp_path / "a.csv", given)) is None


def test_each_of_many_alarms_beside_them_is_looked_through_once(tmp_path, monkeypatch):
    """A PLC writes dozens: of 24 there are 12144 ways to take three."""
    rows = drive()
    random = np.random.default_rng(3)
    alarms = {f"alarm {k}": np.zeros(len(rows)) for k in range(24)}
    for values in alarms.values():
        values[random.integers(0, len(rows), 5)] = 1.0
    looked: list[int] = []
    rises = switches._rises

    def counted(values):
        looked.append(len(values))
        return rises(values)

    monkeypatch.setattr(switches, "_rises", counted)
    found = find_switches(survey(tmp_path / "a.csv", columns(rows) | alarms))
    assert found is not None
    assert found[1].channel == "Endlage Auf + Endlage Zu"
    assert len(looked) <= len(alarms) + 4


def jammed(rows, how):
    """Return rows in which a drive jams in its last third: at an end, or between both."""
    rows = rows.copy()
    asked = np.flatnonzero(np.diff(rows[:, 0]) > 0.0) + 1
    late = slice(int(asked[2 * CYCLES // 3]), None)
    if how == "open":
        late = slice(int(np.argmax(rows[late, 1])) + late.start, None)
    opens, closes = {"closed": (0.0, 1.0), "open": (1.0, 0.0)}.get(how, (0.0, 0.0))
    if how == "short":  # it moves, but not to its open end
        closes = rows[late, 2]
    rows[late, 1], rows[late, 2] = opens, closes
    return rows


@pytest.mark.no_cover
@pytest.mark.parametrize(
    ("how", "fault", "mode"),
    [
        ("", "", ""),
        ("closed", "no_opening", "FTO"),
        ("between", "no_opening", "FTO"),
        ("short", "no_opening", "FTO"),
        ("open", "no_closing", "FTC"),
    ],
)
def test_a_shut_off_valve_that_misses_an_end_says_which(tmp_path, how, fault, mode):
    rows = drive()
    survey(tmp_path / "sound.csv", columns(rows))
    survey(tmp_path / "a.csv", columns(jammed(rows, how) if how else rows))
    config, bag, out = (str(tmp_path / n) for n in ("valve.yaml", "bag", "out.jsonl"))
    assert main(["configure", str(tmp_path / "sound.csv"), "--yes", "--out", config]) == 0
    assert main(["import", str(tmp_path / "a.csv"), "--config", config, "--out", bag]) == 0
    main(["estimate", bag, "--config", config, "--json", out])
    lines = [json.loads(x) for x in (tmp_path / "out.jsonl").read_text().splitlines()]
    verdict, advice = (next(x for x in lines if x["kind"] == k) for k in ("verdict", "advice"))
    assert (verdict["fault"], advice["failure_mode"]) == (fault, mode)
    if how:
        assert verdict["verdict"] == "VALVE"
        assert advice["ne107"] == "failure"
        assert verdict["evidence"].endswith(f"since cycle {2 * CYCLES // 3 + 1}")
    else:
        assert verdict["verdict"] in {"OK", "NO_REFERENCE"}
