# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A valve that obeys the model passes; one with a second value beyond a split does not."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from test.core.valves.press_cartridge.generator import Truth, generate_cycle
from valve_twin.core.estimation.data.masks import find_masks
from valve_twin.core.valves.press_cartridge.estimation.free_run import OutputErrorOptions
from valve_twin.core.valves.press_cartridge.estimation.kalman import fit_kalman
from valve_twin.core.valves.press_cartridge.estimation.kalman_kernel import whiten
from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import (
    N_COLUMNS,
    N_LINEAR,
    Stretch,
)
from valve_twin.core.valves.press_cartridge.estimation.structure import (
    _second_value,
    find_middles,
    second_values,
    whiten_columns,
)

PERIOD_S = 0.03
SIGMA, PROCESS = 1e-3, 2e-4


def guards_of(frames):
    masks = find_masks(frames, PERIOD_S, push=(1.0, -1.0))
    fit = fit_kalman(frames, masks, PERIOD_S, noise_sigma=SIGMA, options=OutputErrorOptions(lag=2))
    return {g.name.removeprefix("structure: "): g for g in fit.guards if "structure" in g.name}


def driven(seed, gain_in=lambda v, x: 0.0101, gain_out=lambda v, x: 0.047, poles=(0.1, 0.1)):
    """Return a cycle of a valve whose gains depend on command and place: four strokes each way."""
    rng = np.random.default_rng([11, seed])
    frames = generate_cycle(Truth(), rng).frames
    n = len(frames)
    inputs = np.zeros((n, 2))
    for stroke in range(4):
        begin = 40 + 200 * stroke
        inputs[begin : begin + 100, 0] = np.repeat(rng.permutation([0.2, 0.35, 0.5, 0.7]), 25)
        inputs[begin + 130 : begin + 150, 1] = np.repeat(rng.permutation([0.2, 0.4, 0.6, 0.75]), 5)
    x = np.zeros(n)
    speed = 0.0
    for k in range(2, n):
        a, b = inputs[k - 2]
        pole = poles[1] if b > 0.0 else poles[0]
        drive = gain_in(a, x[k - 1]) * a - gain_out(b, x[k - 1]) * b
        noise = PROCESS * rng.standard_normal() if a > 0.0 or b > 0.0 else 0.0
        ahead = min(max(x[k - 1] + pole * speed + (1.0 - pole) * drive + noise, 0.0), 1.0)
        speed, x[k] = ahead - x[k - 1], ahead
    return replace(frames, inputs=inputs, position=x + SIGMA * rng.standard_normal(n))


def test_a_valve_that_obeys_the_model_passes():
    """Four standard errors leave 6 in 100 000 checks, a large difference beside."""
    found = [
        guards_of(generate_cycle(Truth(), np.random.default_rng(s)).frames) for s in range(60)
    ]
    found += [guards_of(driven(seed)) for seed in range(10)]
    assert all(g.passed for guards in found for g in guards.values())
    apart = [g.value for guards in found for g in guards.values() if g.name.endswith("level")]
    assert np.nanmedian(apart) == pytest.approx(0.0, abs=0.02)


CASES: dict[str, dict[str, Any]] = {
    "K_in by level": {"gain_in": lambda v, x: 0.0101 if v < 0.4 else 0.0141},
    "K_in by place": {"gain_in": lambda v, x: 0.0101 if x < 0.2 else 0.0065},
    "K_out by level": {"gain_out": lambda v, x: 0.03 if v < 0.5 else 0.05},
    "K_out by place": {"gain_out": lambda v, x: 0.03 if x < 0.2 else 0.05},
    "pole by direction": {"poles": (0.8, 0.1)},
}


@pytest.mark.parametrize("name", CASES)
def test_a_second_value_is_found_and_named(name):
    found = [guards_of(driven(seed, **CASES[name]))[name] for seed in range(5)]
    assert [g.passed for g in found] == [False] * 5, [g.reason for g in found]
    signs = {np.sign(g.value) for g in found}
    assert signs == {-1.0 if name in ("K_in by place", "pole by direction") else 1.0}
    assert "standard errors" in found[0].reason


def test_what_a_cycle_does_not_show_is_said_to_be_unknown():
    frames = generate_cycle(Truth(), np.random.default_rng(2)).frames
    inputs = frames.inputs.copy()
    inputs[:, 0] = np.where(inputs[:, 0] > 0.0, 0.5, 0.0)
    found = guards_of(replace(frames, inputs=inputs))
    assert found["K_in by level"].passed
    assert np.isnan(found["K_in by level"].value)
    assert "cannot be told: 0% of the motion lies at commands above 0.5" in (
        found["K_in by level"].reason
    )


def test_columns_are_whitened_as_those_of_every_fit():
    rng = np.random.default_rng(3)
    n, v_max, pole, ratio = 80, 0.8, 0.4, 0.1
    y = np.cumsum(rng.normal(0.0, 1e-3, n))
    use, free, anchor = (
        rng.random(n) > 0.2,
        np.ones(n, bool),
        np.where(np.arange(n) == 50, np.inf, 0.0),
    )
    moving = np.arange(n) % 20 < 13
    v_in, v_out = np.where(moving, 0.5, 0.0), np.where(rng.random(n) > 0.7, 0.3, 0.0)
    data = Stretch(y, use, free, anchor, moving, v_in, v_out)
    p, expected = np.zeros(N_LINEAR), np.zeros((N_COLUMNS, N_COLUMNS))
    rows = whiten(data, pole, v_max, ratio, p, expected)[1]
    drives = np.column_stack(
        (v_in, v_in * (2 * v_max - v_in), -v_out, -v_out * (2 * v_max - v_out), -np.ones(n))
    )
    gram = np.zeros((N_LINEAR + 1, N_LINEAR + 1))
    assert whiten_columns(*data[:5], drives, pole, ratio, gram) == rows
    keep = [0, 1, 2, 3, 4, 6]
    assert gram == pytest.approx(expected[np.ix_(keep, keep)], rel=1e-12, abs=1e-18)


def test_a_second_value_and_its_error_are_those_of_least_squares():
    rng = np.random.default_rng(5)
    common, splits = rng.standard_normal((200, 3)), rng.standard_normal((200, 2))
    splits = np.column_stack([splits, common[:, 0], np.zeros(200)])  # two that tell nothing
    y = common @ [1.0, -2.0, 0.5] + 0.3 * splits[:, 0] + 0.1 * rng.standard_normal(200)
    matrix = np.column_stack([common, splits, y])
    found = np.zeros((4, 2))
    second_values(matrix.T @ matrix, 3, 200, found)
    for split in range(2):
        u = np.column_stack([common, splits[:, split]])
        theta, cost, *_ = np.linalg.lstsq(u, y)
        error = np.sqrt(cost[0] / (200 - 4) * np.linalg.inv(u.T @ u)[-1, -1])
        assert found[split] == pytest.approx([theta[-1], error], rel=1e-9)
    assert np.isnan(found[2:]).all()


def test_a_split_that_never_moved_tells_nothing_where_rounding_leaves_less_than_nothing():
    """A campaign warned of the root of such a rest."""
    rng = np.random.default_rng(5)
    matrix = np.column_stack([rng.standard_normal((200, 3)), np.zeros(200), rng.random(200)])
    gram = matrix.T @ matrix
    gram[3, 3] = -1e-20
    assert np.isnan(_second_value(gram, 3, 0, 200)).all()


def test_the_middle_of_the_motion_halves_its_amount():
    rng = np.random.default_rng(6)
    y, command = np.cumsum(rng.standard_normal(300)), np.round(rng.random(300), 1)
    moves = rng.random(300) < 0.5
    middles, shares = np.zeros(2), np.zeros(2)
    mean, amount = find_middles(y, moves, command, middles, shares)
    moved = np.where(moves[1:], np.abs(np.diff(y)), 0.0)
    assert mean == pytest.approx(moved @ command[1:] / moved.sum())
    assert amount == pytest.approx(moved.sum())
    for values, middle, share in zip((command[1:], y[:-1]), middles, shares, strict=True):
        assert moved[values < middle].sum() < 0.5 * amount <= moved[values <= middle].sum()
        assert share == pytest.approx(moved[values > middle].sum() / amount)
    none = np.zeros(300, dtype=np.bool_)
    assert find_middles(y, none, command, middles, shares) == (0.0, 0.0)
    assert np.isnan(middles).all()
    assert not shares.any()
