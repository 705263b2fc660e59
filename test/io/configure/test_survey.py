# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from valve_twin.core.valves.registry import get_model
from valve_twin.io.configure.channels import Survey, look
from valve_twin.io.configure.survey import choose, even_step
from valve_twin.io.errors import BagError, ConfigError
from valve_twin.io.instruments.clock import ClockChoice

STEP_S = 0.02
N = 1500


def slew_valve(command, seed=1):
    """Return a position that follows after 4 samples, 30 a second up and 20 down at most."""
    position = np.full(len(command), command[0])
    for k in range(1, len(command)):
        move = np.clip(4.0 * (command[max(k - 4, 0)] - position[k - 1]), -20.0, 30.0)
        position[k] = position[k - 1] + STEP_S * move
    return position + np.random.default_rng(seed).normal(0.0, 0.05, len(command))


def steps(seed=2, low=5.0, high=40.0):
    return np.repeat(np.random.default_rng(seed).uniform(low, high, N // 50), 50)


def switched():
    return np.where((np.arange(N) % 250) < 120, 35.0, 5.0)


def survey(path, columns, step_s=STEP_S):
    table = np.column_stack(list(columns.values()))
    times = step_s * np.arange(len(table))
    lines = [f"{t:.2f}," + ",".join(f"{v:.6f}" for v in row)
             for t, row in zip(times, table, strict=True)]  # fmt: skip
    path.write_text("\n".join([",".join(["t_s", *columns]), *lines]), encoding="utf-8")
    return look([path], ClockChoice())


def chosen(found) -> tuple[Survey, Any]:
    return choose(found)


def test_command_and_position_are_found_by_names_among_others(tmp_path):
    command = steps()
    found = survey(tmp_path / "a.csv", {
        "supply pressure [bar]": 70.0 + np.random.default_rng(3).normal(size=N),
        "spool travel [mm]": slew_valve(command),
        "set point [mm]": command,
        "oil temperature [degC]": 40.0 + 1e-3 * np.arange(N),
    })  # fmt: skip
    timed, choice = chosen(found)
    assert (choice.pair.command, choice.pair.answer) == ("set point [mm]", "spool travel [mm]")
    assert choice.pair.named
    assert choice.trials[0].fit > max(choice.pair.arx, choice.pair.line, 95.0)
    assert timed.period_s == pytest.approx(STEP_S)


@pytest.mark.no_cover
@pytest.mark.usefixtures("one_model")
def test_the_same_is_found_under_names_that_say_nothing(tmp_path):
    command = steps()
    found = survey(tmp_path / "a.csv", {
        "Channel 1": np.random.default_rng(3).normal(size=N),
        "Channel 2": slew_valve(command),
        "Channel 3": command,
    })  # fmt: skip
    _, choice = chosen(found)
    assert (choice.pair.command, choice.pair.answer) == ("Channel 3", "Channel 2")
    assert not choice.pair.named


@pytest.mark.no_cover
@pytest.mark.usefixtures("one_model")
def test_an_answer_that_falls_is_mapped_upside_down(tmp_path):
    command = steps()
    found = survey(tmp_path / "a.csv", {"cmd": command, "pos": 50.0 - slew_valve(command)})
    _, choice = chosen(found)
    answer = choice.trials[0].answer
    assert choice.pair.correlation < 0.0
    assert answer.scale < 0.0
    mapped = answer.of(found.signals["pos"].values)
    assert (mapped.min(), mapped.max()) == pytest.approx((0.0, 1.0), abs=1e-3)


@pytest.mark.no_cover
@pytest.mark.usefixtures("one_model")
def test_a_copy_of_the_command_is_no_position(tmp_path):
    command = steps()
    columns = {"command": command, "position": 0.98 * command + 0.3}
    with pytest.raises(BagError, match="'position' is a copy of 'command'"):
        choose(survey(tmp_path / "a.csv", columns))
    _, choice = chosen(survey(tmp_path / "b.csv", {**columns, "stem": slew_valve(command)}))
    assert choice.pair.answer == "stem"
    assert list(choice.copies) == ["position"]


def test_strokes_without_a_command_are_followed_by_their_timing(tmp_path):
    found = survey(tmp_path / "a.csv", {"stroke [mm]": slew_valve(switched())})
    _, choice = chosen(found)
    assert choice.repeat.channel == "stroke [mm]"
    assert choice.repeat.cycle_s == pytest.approx(5.0, abs=0.005)  # a quarter of a sample


@pytest.mark.no_cover
@pytest.mark.usefixtures("no_black_box")
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_motion_that_integrates_its_command_is_followed(tmp_path, way):
    opening = steps(low=-100.0, high=100.0)
    late = np.concatenate((opening[:1].repeat(3), opening[:-3]))
    beyond = np.sign(late) * np.maximum(np.abs(late) - 15.0, 0.0)
    speed = way * np.where(beyond > 0.0, 0.8, 0.5) * beyond
    motion = STEP_S * np.cumsum(speed) + np.random.default_rng(0).normal(0.0, 0.05, N)
    found = survey(
        tmp_path / "a.csv", {"valve opening [%]": opening, "cylinder position [mm]": motion}
    )
    _, choice = chosen(found)
    best = choice.trials[0]
    assert (choice.pair.command, choice.pair.answer) == (
        "valve opening [%]",
        "cylinder position [mm]",
    )
    assert np.sign(choice.pair.correlation) == way
    assert get_model(best.model).proposed_for == "integrated"
    assert best.fit > max(98.0, choice.pair.arx + 5.0)


@pytest.mark.no_cover
@pytest.mark.usefixtures("no_black_box")
def test_the_longest_lag_of_a_long_record_is_told_in_its_own_samples(tmp_path):
    """The trial is made on each fifth sample, the twin takes all."""
    lag, n = 60, 10 * N
    opening = np.repeat(steps(low=-100.0, high=100.0), 10)
    late = np.concatenate((opening[:1].repeat(lag), opening[:-lag]))
    motion = np.cumsum(0.05 * late) + np.random.default_rng(0).normal(0.0, 0.05, n)
    columns = {"valve opening [%]": opening, "cylinder position [mm]": motion}
    _, choice = chosen(survey(tmp_path / "a.csv", columns))
    best = choice.trials[0]
    assert choice.halves.every == 5
    assert get_model(best.model).proposed_for == "integrated"
    assert best.fit > 95.0
    assert lag <= best.options["max_lag"] <= 3 * lag


def test_noise_gives_one_line_and_no_proposal(tmp_path):
    noise = np.random.default_rng(9).normal(size=(N, 3))
    found = survey(tmp_path / "a.csv", dict(zip("abc", noise.T, strict=True)))
    with pytest.raises(BagError, match="no channel answers another and none repeats") as caught:
        choose(found)
    assert "\n" not in str(caught.value)
    with pytest.raises(ConfigError, match="--position 'd'"):
        choose(found, position="d")


def test_a_bad_file_among_several_is_named_and_left_out(tmp_path):
    command = steps()
    survey(tmp_path / "a.csv", {"cmd": command, "pos": slew_valve(command)})
    (tmp_path / "b.csv").write_text("nothing at all\n", encoding="utf-8")
    survey(tmp_path / "c.csv", {"cmd": command, "other": command})
    survey(tmp_path / "d.csv", {"cmd": command, "pos": slew_valve(command)})
    found = look([tmp_path / f"{x}.csv" for x in "abcd"], ClockChoice())
    assert len(found.recordings) == 2
    assert [str(tmp_path / f"{x}.csv") in t for x, t in zip("bc", found.refused, strict=True)]
    assert "has no channel 'pos'" in found.refused[1]
    with pytest.raises(BagError, match=r"b\.csv"):
        look([tmp_path / "b.csv"], ClockChoice())


@pytest.mark.no_cover
@pytest.mark.usefixtures("no_black_box")
def test_the_boiler_valve_is_found_among_ten_channels(shared):
    path = shared / "damadics_boiler_valve" / "boiler_valve_first_half.csv"
    _, choice = chosen(look([path], ClockChoice()))
    assert (choice.pair.command, choice.pair.answer) == ("LC74_20CV_pct", "LC74_20X_pct")
    assert choice.trials[0].fit > choice.pair.arx + 10.0


@pytest.mark.no_cover
@pytest.mark.usefixtures("no_black_box")
def test_the_cylinder_is_found_among_sixteen_nameless_channels(shared):
    paths = [shared / "eha_cylinder" / "exp_data_2_2.csv.gz"]
    _, choice = chosen(look(paths, ClockChoice()))
    assert (choice.pair.command, choice.pair.answer) == ("ADC1_Channel_13", "ADC1_Channel_14")
    assert choice.trials[0].fit > choice.pair.line


@pytest.mark.no_cover
@pytest.mark.usefixtures("one_model")
def test_reports_of_changes_want_one_grid_and_even_samples_do_not(tmp_path):
    command = steps()
    columns = {"set point [mm]": command, "spool travel [mm]": slew_valve(command)}
    assert even_step(*chosen(survey(tmp_path / "a.csv", columns))) == 0.0

    def stored(name, steps_s):
        times = np.cumsum(steps_s)
        lines = [
            f"{t:.4f},{u:.4f},{y:.4f}" for t, u, y in zip(times, *columns.values(), strict=True)
        ]
        heads = "t_s,set point [mm],spool travel [mm]"
        (tmp_path / name).write_text("\n".join([heads, *lines]), encoding="utf-8")
        return chosen(look([tmp_path / name], ClockChoice()))

    rng = np.random.default_rng(6)
    assert even_step(*stored("b.csv", rng.choice([1.0, 3.0, 8.0, 30.0], N))) == 1.0
    assert even_step(*stored("jitter.csv", rng.uniform(0.7, 1.3, N))) == 0.0
    bursts = np.where(rng.random(N) < 0.2, 0.002, rng.uniform(0.5, 12.0, N))
    step_s = even_step(*stored("bursts.csv", bursts))
    assert bursts.sum() / step_s < 30 * N  # what the reports tell needs no more
    assert step_s > 0.0
