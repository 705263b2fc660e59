# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
from __future__ import annotations

import numpy as np
import pytest

from test.core.survey.test_record import press_columns
from test.io.configure.test_survey import STEP_S, N, chosen, slew_valve, steps, survey
from valve_twin.core.survey.choose import halve_cycles
from valve_twin.core.survey.pairs import Signal
from valve_twin.core.types import CycleRule
from valve_twin.io.configure.proposal import reasons, yaml_text


def stroke(seed):
    """Return a bipolar command with rests, and a ram that it drives from stop to stop."""
    command = np.tile(np.repeat([0.0, 8.0, 0.0, -7.0, 0.0], [20, 80, 60, 90, 50]), N // 300)
    position = np.zeros(N)
    for k in range(1, N):
        u = command[max(k - 3, 0)]
        speed = 6.0 * max(u - 0.5, 0.0) + 9.0 * min(u + 0.5, 0.0)
        position[k] = np.clip(position[k - 1] + STEP_S * speed, 0.0, 50.0)
    return command, position + np.random.default_rng(seed).normal(0.0, 0.02, N)


@pytest.mark.usefixtures("no_black_box")
def test_a_bipolar_command_is_split_into_two_that_drive_the_ram(tmp_path):
    command, ram = stroke(1)
    found = survey(tmp_path / "a.csv", {"valve_cmd_V": command, "ram_mm": ram})
    _, choice = chosen(found)
    sources = {r.signal: r.source for r in choice.driven.roles}
    assert sources["v_in"] == "max(valve_cmd_V, 0)"
    assert sources["v_out"] == "max(-valve_cmd_V, 0)"
    assert choice.plan.rule is CycleRule.COMMANDS


def cylinder(seed, dead=0.6):
    """Return strokes of a bipolar command, each of its own size, and what integrates it late."""
    rng = np.random.default_rng(seed)
    up, down = rng.uniform(5.0, 9.0, (2, N // 300))
    ways = [np.sin(np.pi * np.arange(n) / n) ** 0.5 for n in (80, 90)]
    stroke = [np.zeros(20), ways[0], np.zeros(60), ways[1], np.zeros(50)]
    sizes = np.repeat(np.stack((up, down), axis=1).ravel(), (160, 140) * (N // 300))
    command = (
        np.tile(np.concatenate(stroke) * np.repeat([1.0, -1.0], [160, 140]), N // 300) * sizes
    )
    late = np.concatenate((np.zeros(3), command[:-3]))
    speed = 6.0 * (late - dead).clip(min=0.0) + 5.0 * (late + dead).clip(max=0.0)
    for k in range(1, N):  # the pilot's lag
        speed[k] = speed[k - 1] + 0.4 * (speed[k] - speed[k - 1])
    return command, STEP_S * np.cumsum(speed) + rng.normal(0.0, 0.02, N)


@pytest.mark.no_cover
@pytest.mark.usefixtures("no_black_box")
def test_a_cylinder_whose_command_rests_at_zero_is_no_press(tmp_path):
    """Its two sides drive it as those of the press valve do, whose law knows no dead band."""
    command, ram = cylinder(5)
    found = survey(tmp_path / "a.csv", {"valve_cmd_V": command, "ram_mm": ram})
    _, choice = chosen(found)
    fits = {t.model: t.fit for t in choice.trials}
    assert choice.driven is None
    assert choice.trials[0].model == "integrator"
    assert fits["integrator"] > 95.0 > fits["press_cartridge"] + 3.0


@pytest.mark.no_cover
@pytest.mark.usefixtures("one_model")
def test_a_bipolar_command_that_a_spool_follows_is_not_split(tmp_path):
    command = steps(low=-90.0, high=90.0)
    command = np.where(np.arange(N) % 300 < 60, 0.0, command)
    found = survey(tmp_path / "a.csv", {"cmd [%]": command, "spool [mm]": slew_valve(command)})
    _, choice = chosen(found)
    assert choice.driven is None


@pytest.mark.no_cover
@pytest.mark.usefixtures("no_black_box")
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_the_difference_of_two_pressures_answers_where_neither_does(tmp_path, way):
    rng = np.random.default_rng(3)
    command = steps()
    supply = 100.0 + np.cumsum(rng.normal(0.0, 0.6, N))
    apart = 0.5 * way * slew_valve(command)
    columns = {
        "cmd_pct": command,
        "p_a_bar": supply + apart + rng.normal(0.0, 0.1, N),
        "p_b_bar": supply - apart + rng.normal(0.0, 0.1, N),
    }
    timed, choice = chosen(survey(tmp_path / "a.csv", columns))
    name = "p_a_bar - p_b_bar" if way > 0.0 else "p_b_bar - p_a_bar"
    assert choice.pair.answer == name
    assert choice.pair.correlation > 0.0
    assert choice.trials[0].fit > 70.0
    made = timed.recordings[0].columns[-1]
    assert (made.name, made.unit) == (name, timed.recordings[0].columns[1].unit)


@pytest.mark.no_cover
@pytest.mark.usefixtures("one_model")
def test_two_pressures_of_which_one_answers_alone_are_left_apart(tmp_path):
    command = steps()
    columns = {
        "cmd_pct": command,
        "p_pilot_bar": slew_valve(command),
        "p_supply_bar": 90.0 + np.random.default_rng(4).normal(0.0, 0.3, N),
    }
    _, choice = chosen(survey(tmp_path / "a.csv", columns))
    assert choice.pair.answer == "p_pilot_bar"


def lines_of(found, choice):
    return "\n".join(reasons(found, choice, 1))


def sides_of(command):
    return {"open_cmd_V": command.clip(min=0.0), "close_cmd_V": (-command).clip(min=0.0)}


@pytest.mark.no_cover
@pytest.mark.usefixtures("no_black_box")
@pytest.mark.parametrize("seed", [11, 12])
def test_a_cylinder_of_two_commands_is_no_press(tmp_path, seed):
    """Its two solenoids drive it as the press valve's do, whose law knows no dead band."""
    command, ram = cylinder(seed)
    found = survey(tmp_path / "a.csv", {**sides_of(command), "ram_mm": ram})
    found, choice = chosen(found)
    fits = {t.model: t.fit for t in choice.trials}
    assert (choice.driven, choice.trials[0].model) == (None, "integrator")
    assert choice.pair.command == "open_cmd_V - close_cmd_V"
    assert fits["integrator"] > 95.0 > fits["press_cartridge"]
    told = f"each later cycle: integrator {fits['integrator']:.1f} %"
    assert told in lines_of(found, choice)
    assert 'column: "open_cmd_V - close_cmd_V"' in yaml_text(found, choice, ["a.csv"])


def halves_of(length, pause=0, pauses=()):
    """Return the halves of a record of cycles of some samples, some with a pause in them."""
    lengths = np.full(13, length)
    lengths[list(pauses)] += pause
    opened = np.cumsum([0, *lengths])
    stamp_ns = np.arange(opened[-1]) * 10**7
    number = np.repeat(np.arange(13), lengths)
    signals = {
        k: Signal(k, stamp_ns, np.asarray(number + off, np.float64))
        for k, off in (("u", 0.0), ("y", 100.0))
    }
    return halve_cycles(signals, "u", "y", [int(k) * 10**7 for k in opened])


@pytest.mark.parametrize("pauses", [(), (0,), (0, 5)])
def test_cycles_with_a_pause_are_not_held_against_models(pauses):
    halves = halves_of(300, 10_000, pauses)
    kept = [k for k in range(13) if k not in pauses][:12]
    assert halves.every == 1
    assert not halves.doubt
    assert len(halves.begins) + len(halves.unseen_begins) == len(kept)
    assert halves.first == (300 + 10_000 if 0 in pauses else 0)
    both = np.concatenate((halves.y, halves.unseen_y))
    assert np.array_equal(both, np.repeat(100.0 + np.array(kept), 300))
    assert np.array_equal(np.concatenate((halves.u, halves.unseen_u)), both - 100.0)
    first = (*halves.y[list(halves.begins)], *halves.unseen_y[list(halves.unseen_begins)])
    assert first == tuple(100.0 + np.array(kept))


def test_one_later_cycle_is_a_doubt():
    halves = halves_of(5000)
    assert len(halves.unseen_begins) == 1
    assert halves.doubt == "models were held against a single later cycle; give a longer part"


@pytest.mark.no_cover
@pytest.mark.usefixtures("no_black_box")
def test_a_pause_in_the_first_cycle_makes_a_cylinder_no_press(tmp_path):
    command, ram = cylinder(11)
    columns = {**sides_of(command), "ram_mm": ram}
    columns = {k: np.insert(v, 295, np.full(10_000, v[295])) for k, v in columns.items()}
    _, choice = chosen(survey(tmp_path / "a.csv", columns))
    assert (choice.driven, choice.trials[0].model) == (None, "integrator")
    assert choice.trials[0].fit > 95.0


@pytest.mark.no_cover
@pytest.mark.usefixtures("no_black_box")
@pytest.mark.parametrize("layer", [{}, {"noise": 4e-3, "refresh": 4}])
def test_a_press_of_two_commands_is_held_against_what_else_follows(tmp_path, layer):
    table = press_columns(**layer)
    columns = {f"{k}_cmd": table[k].values for k in ("up", "down")}
    path = tmp_path / "a.csv"
    found, choice = chosen(survey(path, {**columns, "spool": table["x"].values}, 0.03))
    fits = {t.model: t.fit for t in choice.trials}
    assert (choice.driven.model, choice.trials[0].model) == ("press_cartridge",) * 2
    assert fits["press_cartridge"] > 85.0
    rivals = [m for m, fit in fits.items() if fit > fits["press_cartridge"]]
    lines = lines_of(found, choice)
    assert f"press_cartridge {fits['press_cartridge']:.1f} %, " in lines
    assert [f"doubt: {m} follows as well" in lines for m in rivals] == [True] * len(rivals)


@pytest.mark.no_cover
@pytest.mark.usefixtures("no_black_box")
def test_one_cycle_of_two_commands_says_that_nothing_was_compared(tmp_path):
    command, ram = cylinder(5)
    columns = {k: v[:500] for k, v in {**sides_of(command), "ram_mm": ram}.items()}
    found, choice = chosen(survey(tmp_path / "a.csv", columns))
    assert choice.driven is not None
    assert "too few cycles to hold any model against" in lines_of(found, choice)
