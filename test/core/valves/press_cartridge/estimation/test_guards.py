# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is checked of a cycle: values with a reason, whether they passed or not."""

from dataclasses import replace

import numpy as np
import pytest

from test.core.valves.press_cartridge.generator import Truth, generate_cycle
from valve_twin.core.types import Cycle, EstimateStatus, ParameterStatus
from valve_twin.core.valves.press_cartridge import MODEL
from valve_twin.core.valves.registry import complete_options

OPTIONS = complete_options(MODEL, {"lag": 2})
TRUTH = Truth(leak=0.0, pole=0.0)


def estimates(frames, **options):
    given = replace(OPTIONS, **options)
    return {e.estimator: e for e in MODEL.estimate(Cycle(1, 0.03, frames), given)}


def guards(estimate):
    return {g.name: g for g in estimate.guards}


def frames_of(truth=None, seed=1):
    return generate_cycle(truth or Truth(), np.random.default_rng([3, seed])).frames


def strokes(out_levels, begins=(60, 260, 460, 660), sigma=1e-3, seed=1):
    """Return a cycle that is filled at two levels and emptied in eight samples at the given."""
    rng = np.random.default_rng([4, seed])
    frames = frames_of(seed=seed)
    n = len(frames)
    inputs = np.zeros((n, 2))
    for begin in begins:
        inputs[begin : begin + 40, 0], inputs[begin + 40 : begin + 80, 0] = 0.3, 0.6
        inputs[begin + 130 : begin + 138, 1] = rng.choice(out_levels, 8)
    late = np.vstack([np.zeros((2, 2)), inputs[:-2]])
    gain_out = TRUTH.k_out + TRUTH.k_out_slope * (late[:, 1] - TRUTH.v_ref)
    x, free = np.zeros(n), TRUTH.k_in * late[:, 0] - gain_out * late[:, 1]
    for k in range(1, n):
        x[k] = min(max(x[k - 1] + free[k], 0.0), 1.0)
    return replace(frames, inputs=inputs, position=x + sigma * rng.standard_normal(n))


def test_a_good_cycle_passes_every_check_of_both_estimators():
    found = estimates(frames_of())
    for name in ("output_error", "kalman"):
        assert [g.reason for g in found[name].guards if not g.passed] == []
    assert len(found["kalman"].guards) > len(found["output_error"].guards) > 8
    assert found["equation_error_qp4"].guards == ()
    noise = guards(found["output_error"])["noise at rest"]
    assert noise.value == pytest.approx(1e-3, rel=0.2)


def test_a_gain_away_from_all_commands_is_a_ridge_with_its_slope():
    """The gain at the levels that act is known; K_out at v_ref = 0.3 and its slope are not."""
    short = strokes([0.72, 0.8], begins=(60,), sigma=8e-3, seed=23)
    fit = estimates(short, pole_fixed=0.0, lag=2)["kalman"]
    refused = [p for p in fit.parameters if p.status is ParameterStatus.REFUSED]
    assert {p.name for p in refused} == {"K_out", "K_out_slope"}
    assert fit.status is EstimateStatus.PARTIAL
    check = guards(fit)["identifiability"]
    assert not check.passed
    assert check.value > check.limit
    assert check.reason.startswith("K_out and K_out_slope are not told apart; known: 1*K_out +")
    assert refused[0].reason == check.reason
    assert check.reason in fit.reason
    known = float(check.reason.split(" = ")[1].split()[0])
    level = TRUTH.k_out + TRUTH.k_out_slope * (0.76 - TRUTH.v_ref)
    assert known == pytest.approx(level, rel=0.03)
    wide = estimates(strokes([0.15, 0.3, 0.5, 0.8]))["kalman"]
    assert guards(wide)["identifiability"].passed
    assert wide.value("K_out") == pytest.approx(TRUTH.k_out, rel=0.03)


def test_a_direction_without_motion_is_named():
    frames = frames_of()
    still = replace(frames, inputs=frames.inputs * np.array([1.0, 0.0]))
    found = guards(estimates(still)["output_error"])
    assert found["excitation of inflow"].passed
    assert not found["excitation of outflow"].passed
    assert found["excitation of outflow"].reason == "the command is never on"


def test_a_command_of_one_level_is_named():
    frames = frames_of()
    inputs = frames.inputs.copy()
    inputs[:, 0] = np.where(inputs[:, 0] > 0.0, 0.5, 0.0)
    found = guards(estimates(replace(frames, inputs=inputs))["output_error"])
    assert not found["levels of inflow"].passed
    assert "one level only" in found["levels of inflow"].reason
    assert found["levels of inflow"].reason.endswith("the gain is that at 0.5")


def test_noise_opens_the_gap_to_the_equation_error():
    """A slow pole: the equation error takes noise for a fast one (equations.md 2.6)."""
    quiet, noisy = (
        guards(estimates(frames_of(Truth(pole=0.6, sigma=sigma)))["output_error"])
        for sigma in (1e-5, 1e-3)
    )
    for name in ("K_in", "K_out", "pole"):
        gap = quiet[f"equation-error gap of {name}"]
        assert gap.passed
        assert abs(gap.value) < 0.05
    gap = noisy["equation-error gap of pole"]
    assert not gap.passed
    assert gap.value == pytest.approx(-0.6, abs=0.1)
    assert "pole by equation error differs by -0." in gap.reason


def test_noise_above_what_was_measured_fails():
    found = guards(estimates(strokes([0.3, 0.8], sigma=7e-3))["output_error"])["noise at rest"]
    assert not found.passed
    assert found.value == pytest.approx(7e-3, rel=0.2)


def test_a_refused_cycle_has_nothing_to_check():
    frames = frames_of()
    found = estimates(replace(frames, inputs=np.zeros_like(frames.inputs)))
    assert found["output_error"].status is EstimateStatus.REFUSED
    assert found["output_error"].guards == found["kalman"].guards == ()


def test_no_cycle_however_wrong_raises():
    """Commands of noise, exchanged commands, an inverted or constant or patchy position."""
    rng = np.random.default_rng(0)
    seen = set()
    for _ in range(100):
        sigma, pole = 10 ** rng.uniform(-6.0, -1.5), rng.choice([0.0, 0.1, 0.6, 0.95])
        frames = generate_cycle(Truth(sigma=sigma, pole=float(pole)), rng).frames
        x, u = frames.position, frames.inputs
        wrong = (
            replace(frames, inputs=rng.random(u.shape)),
            replace(frames, inputs=u[:, ::-1].copy()),
            replace(frames, position=1.0 - x),
            replace(frames, position=np.full(len(x), 0.3)),
            replace(frames, position=np.where(rng.random(len(x)) < 0.3, np.nan, x)),
            frames[: int(rng.integers(1, 120))],
        )
        for found in estimates(wrong[rng.integers(len(wrong))], lag=-1).values():
            seen.add(found.status)
            assert all(isinstance(g.passed, bool) for g in found.guards)
            assert all(g.name and g.reason for g in found.guards)
    assert EstimateStatus.REFUSED in seen
    assert len(seen) > 1
