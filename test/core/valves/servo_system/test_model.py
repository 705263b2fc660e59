# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The servosystem's twin: what it recovers, withholds, refuses and predicts."""

from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from test.core.valves import blocks
from valve_twin.core.estimation.cycle.sequence import evaluate
from valve_twin.core.estimation.data.robust import NORMAL_975
from valve_twin.core.simulation import SimulatedValve, configure, to_frames
from valve_twin.core.simulation.program import CycleProgram
from valve_twin.core.types import Cycle, EstimateStatus, ParameterStatus
from valve_twin.core.valves.kit.tolerances import Tolerated, tolerated
from valve_twin.core.valves.registry import complete_options, get_model, get_simulation
from valve_twin.core.valves.servo_system import model as servo_model
from valve_twin.core.valves.servo_system.constants import VISCOSITY, recall
from valve_twin.core.valves.servo_system.constants import _contradiction as contradiction_of
from valve_twin.core.valves.servo_system.fit import START, UNKNOWNS, rank
from valve_twin.core.valves.servo_system.fit import _result as result_of
from valve_twin.core.valves.servo_system.parameters import NAMES
from valve_twin.core.valves.servo_system.plant import ServoSystemPlant, default_simulation

MODEL = get_model("servo_system")
OPTIONS = complete_options(MODEL, {})
CLEAN = {"plant.sensor_noise": 0.0, "plant.sensor_quantum": 0.0, "measurement.noise": 0.0,
         "measurement.quantum": 0.0}  # fmt: skip
AWAY = {
    "discharge": 0.7,
    "leak_discharge": 0.5,
    "bulk_modulus": 1.2e9,
    "viscous_friction": 50.0,
    "coulomb_friction": 30.0,
    "hysteresis_width": 2e-3,
    "structural_stiffness": 1.8e6,
}
"""Where searches start: 10 to 20 % off the plant."""


def record(given=None, seed=1):
    """A cycle after the first one, as the sensors give it."""
    config = configure(
        get_simulation("servo_system"), {"plant.sensor_seed": seed, **(given or {})}
    )
    valve = SimulatedValve(config, seed)
    valve.advance(config.cycle_samples)
    return Cycle(2, config.period_s, to_frames(valve.advance(config.cycle_samples)))


def spoil(cycle, signal, values):
    frames = cycle.frames
    if signal == MODEL.output:
        return replace(cycle, frames=replace(frames, position=values))
    inputs = frames.inputs.copy()
    inputs[:, MODEL.inputs.index(signal)] = values
    return replace(cycle, frames=replace(frames, inputs=inputs))


@pytest.fixture(scope="module")
def cycle():
    return record()


@pytest.fixture(scope="module")
def estimate(cycle):
    (found,) = MODEL.estimate(cycle, replace(OPTIONS, **AWAY))
    return found


@pytest.mark.no_cover
def test_a_production_cycle_tells_every_parameter_within_its_interval(estimate):
    assert estimate.status is EstimateStatus.ACCEPTED
    truth = ServoSystemPlant()
    for value in estimate.parameters:
        sigma = (value.upper_95 - value.lower_95) / (2.0 * NORMAL_975)  # with the constants'
        off = abs(value.value - getattr(truth, value.name)) / sigma
        assert off < 3.5, value.name  # once in 2000
        assert value.lower_95 < value.value < value.upper_95


@pytest.mark.no_cover
def test_the_stated_accuracies_are_reached(estimate):
    truth = ServoSystemPlant()
    shares = {
        "discharge": 0.005,
        "bulk_modulus": 0.01,
        "structural_stiffness": 0.01,
        "hysteresis_width": 0.01,
        "leak_discharge": 0.05,
        "coulomb_friction": 0.05,
    }
    for name, share in shares.items():
        assert estimate.value(name) == pytest.approx(getattr(truth, name), rel=share), name


def rich(seed, *, duration_s=12.0, period_s=1e-4):
    """Long strokes to and fro, every signal with white noise of 0.5 % of its range."""
    moves = int((duration_s - 0.3) / 0.55)
    program = CycleProgram(
        times_s=tuple(round(0.55 * k, 3) for k in range(moves)),
        kinds=("step",) * moves,
        targets=tuple(0.9 if k % 2 == 0 else 0.1 for k in range(moves)),
        duration_s=duration_s,
        step_time_s=0.0,
    )
    config = replace(configure(default_simulation(), CLEAN), program=program, period_s=period_s)
    frames = to_frames(SimulatedValve(config, 1).advance(config.cycle_samples))
    random = np.random.default_rng(seed)
    inputs = frames.inputs.copy()
    noise = 0.005 * np.ptp(inputs[:, 1:], axis=0)
    inputs[:, 1:] += noise * random.standard_normal(inputs[:, 1:].shape)
    position = frames.position + 0.005 * np.ptp(frames.position) * random.standard_normal(
        len(frames)
    )
    return Cycle(1, period_s, replace(frames, position=position, inputs=inputs))


def check_rich(seeds, **shape):
    truth, found = ServoSystemPlant(), []
    for seed in seeds:
        (estimate,) = MODEL.estimate(rich(seed, **shape), replace(OPTIONS, **AWAY))
        found.append([estimate.value(n) / getattr(truth, n) for n in NAMES])
    return dict(zip(NAMES, np.array(found).T, strict=True))


def test_a_rich_record_at_half_a_percent_noise_gives_discharge_and_bulk_modulus():
    """A short record; the viscous friction needs the long one."""
    found = check_rich([0], duration_s=3.0, period_s=1e-3)
    for name in ("discharge", "bulk_modulus", "structural_stiffness"):
        assert found[name] == pytest.approx(1.0, abs=0.05), name


@pytest.mark.slow
def test_a_rich_record_gives_discharge_bulk_modulus_and_viscous_friction_within_5_percent():
    """12 s at 10 kHz; the standard error of the viscous friction is 2.5 %."""
    found = check_rich(range(6))
    for name in ("discharge", "bulk_modulus"):
        assert found[name] == pytest.approx(1.0, abs=0.05), name
    viscous = found["viscous_friction"]
    assert viscous.mean() == pytest.approx(1.0, abs=0.05)
    assert np.abs(viscous - 1.0).max() < 0.10  # four standard errors


def test_what_a_small_move_does_not_tell_is_withheld_and_not_invented():
    small = {
        "program.times_s": [0.0, 0.3],
        "program.kinds": ["step", "step"],
        "program.targets": [0.53, 0.5],
        "program.duration_s": 1.0,
    }
    (found,) = MODEL.estimate(record(small), replace(OPTIONS, viscous_friction=50.0))
    assert found.status is EstimateStatus.PARTIAL
    values = {v.name: v for v in found.parameters}
    assert values["viscous_friction"].status is ParameterStatus.NOT_EXCITED
    assert "standard error" in values["viscous_friction"].reason
    assert np.isnan(values["viscous_friction"].value)
    assert found.value("discharge") == pytest.approx(0.62, rel=0.05)


def test_ranking_takes_the_most_sensitive_and_leaves_what_they_explain():
    random = np.random.default_rng(3)
    jacobian = random.standard_normal((400, UNKNOWNS))
    jacobian[:, 5] = jacobian[:, 2] + 1e-3 * jacobian[:, 5]  # nearly the same as another
    jacobian[:, 7] *= 1e-3  # nearly nothing
    free = rank(jacobian, np.ones(UNKNOWNS), 0.1)
    assert free[2] != free[5]
    assert not free[7]
    assert free[[0, 1, 3, 4, 6]].all()
    assert free[START:].all()


def test_the_estimate_does_not_depend_on_what_came_before(cycle, estimate):
    (again,) = MODEL.estimate(cycle, OPTIONS, (estimate,))
    for value in estimate.parameters[: len(NAMES)]:  # the constants are kept, not told again
        assert again.value(value.name) == pytest.approx(value.value, abs=value.standard_error)


@pytest.mark.no_cover
@pytest.mark.parametrize("share", [0.8, 1.2])
def test_oil_of_another_temperature_is_told_by_its_own_cycle(estimate, share):
    """6 K: the leak read as -54 or +50 %, viscous friction as -44 or +56 %, all accepted."""
    plant = ServoSystemPlant()
    now = record({"plant.viscosity": share * plant.viscosity}, seed=6)
    (found,) = MODEL.estimate(now, OPTIONS, (estimate,))
    assert found.status is EstimateStatus.ACCEPTED, found.reason
    for value in found.parameters[: len(NAMES)]:
        half = 0.5 * (value.upper_95 - value.lower_95)
        off = abs(value.value - getattr(plant, value.name))
        assert off < 1.8 * half, value.name  # 3.5 standard errors
    assert found.value("viscosity") == pytest.approx(share * plant.viscosity, rel=0.03)


@pytest.mark.no_cover
def test_oil_of_another_temperature_refuses_no_cycle_that_tells_one_parameter_more(estimate):
    """The constants are found anew then: a viscosity +20 % off was beyond its tolerance."""
    plant = ServoSystemPlant()
    now = record({"plant.viscosity": 1.2 * plant.viscosity}, seed=6)
    name = "structural_damping"
    kept = tuple(v for v in estimate.parameters if v.name != name)
    (found,) = MODEL.estimate(now, OPTIONS, (replace(estimate, parameters=kept),))
    assert found.status is EstimateStatus.ACCEPTED, found.reason
    assert found.value("viscosity") == pytest.approx(1.2 * plant.viscosity, rel=0.03)
    assert found.value(name) == pytest.approx(getattr(plant, name), rel=0.03)


@pytest.mark.parametrize(("share", "told"), [(1.3, ""), (0.6, ""), (1.7, "viscosity +70 %")])
def test_the_oil_s_temperature_is_no_contradiction(share, told):
    unsure = Tolerated((VISCOSITY, "stroke"), np.array([0.1, 0.002]))
    errors = np.array([0.01, 0.001])
    assert told in (why := contradiction_of(np.array([share, 1.0]), errors, unsure))
    assert bool(why) == bool(told)


def test_the_viscosity_is_as_sure_where_the_constants_are_published_again(estimate):
    """Its error of the cycle before was added to its own, in each 26th cycle."""
    unsure, since = tolerated(OPTIONS), replace(estimate, parameters=estimate.parameters[:1])
    shown = []
    for count in (1, 30):
        known = recall((estimate, *[since] * count), unsure, OPTIONS)
        assert known.due == (count == 30)
        found = {p.name: p for p in known.published((0.0, 0.01))}
        shown.append(found[VISCOSITY])
    assert shown[0] == shown[1]


def test_a_constant_beside_the_viscosity_contradicts_as_before():
    unsure = Tolerated((VISCOSITY, "stroke"), np.array([0.1, 0.002]))
    why = contradiction_of(np.array([1.3, 1.02]), np.array([1e-3, 1e-3]), unsure)
    assert "stroke +2 %" in why


@pytest.mark.no_cover
def test_predicts_the_next_cycle(estimate):
    values = {v.name: v.value for v in estimate.parameters}
    coefficients = MODEL.coefficients(values, 0, 1e-3, OPTIONS)
    mse, fit = evaluate(MODEL, coefficients, record(seed=4).frames, 1e-3)
    assert fit > 98.5  # the noise of the position alone takes 0.5
    assert np.sqrt(mse) < 1.3e-3


def test_prediction_is_the_same_in_any_blocks(cycle):
    coefficients = MODEL.coefficients({}, 0, 1e-3, OPTIONS)
    given = MODEL, coefficients, cycle.frames[:300], blocks.marked(300, {120: 3})
    whole, cut = blocks.predict(*given), blocks.predict(*given, (1, 77))
    for one, other in zip(whole, cut, strict=True):
        np.testing.assert_array_equal(one, other)
    predicted, simulated, codes = whole
    assert codes[120] == 5
    assert codes[0] == 2
    assert np.isfinite([predicted[1:], simulated[1:]]).all()


@pytest.mark.parametrize("signal", [*MODEL.inputs, MODEL.output])
def test_refuses_a_signal_of_nothing_but_not_a_number_by_its_name(cycle, signal):
    (found,) = MODEL.estimate(spoil(cycle, signal, np.nan * cycle.frames.position), OPTIONS)
    assert found.status is EstimateStatus.REFUSED
    assert found.reason.startswith(f"{signal}: 4000 of 4000 values")


def test_some_samples_that_are_no_numbers_do_no_harm(cycle, estimate):
    pressure = cycle.frames.inputs[:, MODEL.inputs.index("pressure_1")].copy()
    pressure[::37] = np.nan
    (found,) = MODEL.estimate(spoil(cycle, "pressure_1", pressure), OPTIONS, (estimate,))
    assert found.counts.bad == len(pressure[::37])
    assert found.value("discharge") == pytest.approx(0.62, rel=0.005)


def test_refuses_sampling_too_slow_for_its_modes(cycle):
    (found,) = MODEL.estimate(replace(cycle, period_s=0.01), OPTIONS)
    assert found.reason.startswith("sampled every 0.01 s")
    assert "from 0 to 0.002 s" in found.reason


def test_refuses_options_that_contradict_each_other(cycle):
    (found,) = MODEL.estimate(cycle, replace(OPTIONS, supply_underlap=1e-3))
    assert found.reason.startswith("supply_underlap = 0.001: must be a number from 0 to 0.0007")
    assert np.isnan(MODEL.coefficients({}, 0, 1e-3, replace(OPTIONS, stroke=0.5))).all()


def test_refuses_a_cycle_at_rest(cycle):
    still = cycle.frames[3800:4000]
    many = replace(cycle, frames=still)
    (found,) = MODEL.estimate(many, OPTIONS)
    assert "less than min_motion" in found.reason


def test_refuses_a_gap():
    frames = record().frames
    kept = np.r_[0:1000, 1100:4000]
    names = ("stamp_ns", "position", "inputs", "counter", "reference", "valid")
    parts = {name: getattr(frames, name)[kept] for name in names}
    (found,) = MODEL.estimate(Cycle(1, 1e-3, type(frames)(**parts)), OPTIONS)
    assert found.reason.startswith("a gap of 100 samples")


@pytest.mark.no_cover
def test_refuses_a_load_that_the_options_do_not_know():
    short = rich(0, duration_s=3.0, period_s=1e-3)
    (found,) = MODEL.estimate(short, replace(OPTIONS, load_inertia=0.25))
    assert found.status is EstimateStatus.REFUSED
    assert "times the noise of the signals" in found.reason or "tolerance" in found.reason


def test_a_search_of_constants_that_fails_publishes_no_value_without_its_interval(
    cycle, monkeypatch
):
    monkeypatch.setattr(servo_model, "open_constants", lambda *_: None)
    (estimate,) = MODEL.estimate(cycle, OPTIONS, ())
    assert estimate.status is EstimateStatus.REFUSED
    assert estimate.reason.startswith("no interval: the simulation fails in the search")


def test_constants_without_tolerance_are_not_searched(cycle, monkeypatch):
    def search(*_):
        raise AssertionError

    monkeypatch.setattr(servo_model, "open_constants", search)
    names = {f.name: 0.0 for f in fields(OPTIONS.tolerances)}
    exact = replace(OPTIONS, tolerances=replace(OPTIONS.tolerances, **names))
    (estimate,) = MODEL.estimate(cycle, exact, ())
    assert estimate.status is not EstimateStatus.REFUSED
    assert all(np.isfinite(p.upper_95) for p in estimate.parameters if p.usable)
    assert "viscosity" not in {p.name for p in estimate.parameters}


@pytest.mark.no_cover
def test_constants_off_inside_their_tolerances_leave_the_intervals_true():
    """A stroke 0.2 % longer alone read as 50 % more viscous friction, told to 13 %."""
    plant = ServoSystemPlant()
    shares = {"stroke": 2e-3, "port_radius": -1e-2, "pressure_scale": 5e-3}
    true = {name: getattr(plant, name) * (1.0 + share) for name, share in shares.items()}
    given = {f"plant.{name}": value for name, value in true.items()}
    (found,) = MODEL.estimate(record(given, seed=4), OPTIONS)
    for value in found.parameters[: len(NAMES)]:
        half = 0.5 * (value.upper_95 - value.lower_95)
        off = abs(value.value - getattr(plant, value.name))
        assert off < 1.8 * half, value.name  # 3.5 standard errors
    for name, value in true.items():
        assert found.value(name) == pytest.approx(value, rel=0.4 * abs(shares[name])), name


def test_errors_grow_once_with_what_the_fit_leaves():
    samples = SimpleNamespace(weight=np.ones((200, 9)))
    given: Any = SimpleNamespace(record=samples, base=np.ones(START))
    jacobian = np.random.default_rng(1).normal(size=(1803, UNKNOWNS))
    free = np.ones(UNKNOWNS, dtype=np.bool_)
    x = np.ones(UNKNOWNS)
    as_noise, thrice = (result_of(given, x, r * np.ones(1803), jacobian, free) for r in (1.0, 3.0))
    assert thrice.misfit == pytest.approx(3.0 * as_noise.misfit)
    np.testing.assert_allclose(thrice.errors, 3.0 * as_noise.errors, rtol=0.01)  # with a floor
    assert thrice.warmed[1] == pytest.approx(3.0 * as_noise.warmed[1])
