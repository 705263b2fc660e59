# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A cycle says what it excites, and why it does not excite the rest."""

import numpy as np
import pytest

from valve_twin.core.estimation.data.masks import find_masks
from valve_twin.core.valves.press_cartridge.estimation.excitation import (
    GuardOptions,
    assess_input,
    independent_terms,
    term_reasons,
)
from valve_twin.core.valves.press_cartridge.estimation.regression import gram, usable_rows

PERIOD_S = 0.03
N = 120


@pytest.fixture
def assess(make_frames):
    """Return a function that assesses inflow and outflow of a motion at lag 1."""

    def run(position, v_in, v_out, **others):
        frames = make_frames(position, v_in, v_out)
        masks = find_masks(frames, PERIOD_S, push=(1.0, -1.0))
        rows = usable_rows(frames, masks, 1)
        both = [assess_input(frames, rows, 1, k, **others) for k in (0, 1)]
        return *both, gram(frames, rows, 1)

    return run


def rising(slope=1e-3):
    return 0.2 + slope * np.arange(N)


def test_an_input_that_moves_the_spool_at_several_levels_is_excited_and_graded(assess):
    inflow, outflow, _ = assess(rising(), np.linspace(0.1, 0.5, N), 0.0)
    assert inflow.excited
    assert inflow.graded
    assert inflow.reason == ""
    assert inflow.travel == pytest.approx(1e-3 * inflow.samples)
    assert inflow.level == pytest.approx(0.3, rel=0.02)
    assert not outflow.excited
    assert outflow.reason == "the command is never on"


def test_one_level_gives_the_gain_but_not_its_dependence_on_the_level(assess):
    inflow, _, _ = assess(rising(), 0.3, 0.0)
    assert inflow.excited
    assert not inflow.graded
    assert "one level only" in inflow.reason


def test_too_few_samples_are_refused_with_their_number(assess):
    inflow, _, _ = assess(rising(), np.r_[np.zeros(N - 4), np.full(4, 0.3)], 0.0)
    assert not inflow.excited
    assert inflow.reason == "the command is on in 3 rows, 5 needed"


def test_travel_has_to_exceed_the_noise(assess):
    slow = rising(1e-4)
    assert assess(slow, np.linspace(0.1, 0.5, N), 0.0, noise_sigma=1e-3)[0].excited
    noisy = assess(slow, np.linspace(0.1, 0.5, N), 0.0, noise_sigma=4e-3)[0]
    assert not noisy.excited
    assert "0.02 needed" in noisy.reason


def test_limits_are_options(assess):
    strict = GuardOptions(min_samples=200)
    assert not assess(rising(), np.linspace(0.1, 0.5, N), 0.0, options=strict)[0].excited


def test_terms_are_refused_with_the_input_they_need(assess):
    reasons = term_reasons(*assess(rising(), np.linspace(0.1, 0.5, N), 0.0))
    refused = [k + 1 for k, reason in enumerate(reasons) if reason]
    assert refused == [3, 5, 6, 8]
    assert reasons[2] == "outflow: the command is never on"
    assert reasons[5] == "both commands are never on together"


def test_a_resting_valve_excites_nothing(assess):
    reasons = term_reasons(*assess(np.full(N, 0.3), 0.0, 0.0))
    assert all(reasons)
    assert reasons[0] == "the spool does not move on command"


def test_dependent_terms_are_left_out_in_the_order_given(make_frames):
    rng = np.random.default_rng(1)
    v_in = np.where(rng.random(N) > 0.5, 0.4, 0.0)  # two levels: v^2 = 0.4 v
    frames = make_frames(0.5 + 0.1 * rng.random(N), v_in, 0.5 * rng.random(N))
    rows = usable_rows(frames, find_masks(frames, PERIOD_S, push=(1.0, -1.0)), 1)
    g = gram(frames, rows, 1)
    assert independent_terms(g, (1, 2, 3, 4, 5), 1e6) == (1, 2, 3, 5)
    assert independent_terms(g, (1, 4, 2), 1e6) == (1, 4)
    assert independent_terms(g, (), 1e6) == ()
