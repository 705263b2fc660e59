# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Identification from the records of a test bench: static forces, ring-down, current steps."""

import numpy as np
import pytest

from valve_twin.core.estimation.solvers.nonlinear import FitStatus, Method
from valve_twin.core.valves.hybrid_actuator import bench_fits
from valve_twin.core.valves.hybrid_actuator.magnetics import (
    FIT,
    KERNELS,
    LINEAR,
    REGULAR,
    Magnetics,
    coil_current,
)
from valve_twin.core.valves.hybrid_actuator.plant import HybridActuatorPlant
from valve_twin.core.valves.hybrid_actuator.plant_kernel import FLUX_OPENER, STATE_SIZE, X, follow
from valve_twin.core.valves.hybrid_actuator.ring_down import fit_ring_down
from valve_twin.core.valves.hybrid_actuator.static_force import (
    ForceCurve,
    fit_static_force,
    forces,
)
from valve_twin.core.valves.hybrid_actuator.transient import StepRecord, fit_steps

TRUTH = {
    "beta": 2.8e-7,
    "kappa": 1.04e-6,
    "saturation_flux": 0.046,
    "c1": 7.0e-6,
    "c2": 6.04e-5,
    "c3": 2.18e-4,
}
GAPS = np.arange(0.5e-3, 4.01e-3, 0.25e-3)
CURRENTS = (5.0, 12.5, 25.0, 40.0)


def solenoid(kernel, **changes):
    values = {**TRUTH, **changes}
    bare = Magnetics(kernel, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-3, 0.0)
    return bare._replace(**values)


def curves(kernel, sigma=0.0, seed=0):
    rng = np.random.default_rng(seed)
    out = []
    for current in CURRENTS:
        true = forces(solenoid(kernel), GAPS, np.full(len(GAPS), current))
        out.append(ForceCurve(GAPS, true + sigma * rng.standard_normal(len(GAPS)), current))
    return out


@pytest.mark.parametrize("method", Method, ids=lambda m: m.value)
@pytest.mark.parametrize("kernel", [LINEAR, REGULAR, FIT])
def test_recovers_the_kernel_from_clean_curves(kernel, method):
    fit = fit_static_force(curves(kernel), KERNELS[kernel], method=method)
    assert fit.status is FitStatus.OK
    assert fit.r_square > 1.0 - 1e-12
    for name, value in zip(fit.names, fit.values, strict=True):
        assert value == pytest.approx(TRUTH[name], rel=1e-4)


@pytest.mark.parametrize("kernel", [LINEAR, REGULAR, FIT])
def test_standard_errors_cover_the_truth_at_the_noise_of_the_load_cell(kernel):
    """0.56 N: 38 kg/V at the resolution of the converter (equations.md 1.1)."""
    hits, count = 0, 0
    for seed in range(30):
        fit = fit_static_force(curves(kernel, 0.56, seed), KERNELS[kernel])
        off = [abs(fit.value(n) - TRUTH[n]) / fit.standard_error(n) for n in fit.names]
        hits += sum(o < 2.0 for o in off if np.isfinite(o))
        count += sum(np.isfinite(off))
    assert count > 30
    assert hits / count > 0.85  # 95 % within 2 standard errors, correlated parameters


def test_force_offsets_are_local_to_their_curve():
    given = [
        ForceCurve(c.gap, c.force + zero, c.current)
        for c, zero in zip(curves(REGULAR), (0.0, 2.0, -1.5, 3.0), strict=True)
    ]
    fit = fit_static_force(given, "saturating", force_offsets=True)
    found = [fit.value(f"force_offset[{k}]") for k in range(4)]
    np.testing.assert_allclose(found, [0.0, 2.0, -1.5, 3.0], atol=1e-3)
    assert fit.value("saturation_flux") == pytest.approx(0.046, rel=1e-3)
    assert fit.status is FitStatus.OK


def test_the_wrong_kernel_shows_in_the_fit():
    clean = curves(REGULAR)
    right = fit_static_force(clean, "saturating")
    wrong = fit_static_force(clean, "linear")
    assert wrong.reduced_chi_square > 100.0 * max(right.reduced_chi_square, 1e-12)
    assert wrong.adjusted_r_square < right.adjusted_r_square


def test_refuses_static_curves_that_are_no_gaps():
    with pytest.raises(ValueError, match=r"gap = 0\.0: must be a number above 0"):
        fit_static_force([ForceCurve(np.zeros(3), np.ones(3), 1.0)], "linear")
    with pytest.raises(ValueError, match="kernel = 'cubic'"):
        fit_static_force(curves(LINEAR), "cubic")


def thesis_ring(xi=0.0824, omega=441.1, sigma=0.0, seed=0):
    t = np.arange(0.0, 0.06, 1e-4)
    damped = omega * np.sqrt(1.0 - xi**2)
    clean = 3.26 * np.exp(-xi * omega * t) * np.sin(damped * t - 1.669)
    return t, clean + sigma * np.random.default_rng(seed).standard_normal(len(t))


def ring_down(**given):
    t, x = thesis_ring(**given)
    return fit_ring_down(t, x, 18820.0)


def test_ring_down_of_the_thesis():
    """The printed frequencies need xi = 0.0824 (equations.md 1.2, item 4)."""
    found = ring_down()
    assert found.damping_ratio == pytest.approx(0.0824, rel=1e-8)
    assert found.natural_frequency == pytest.approx(441.1, rel=1e-8)
    assert found.fit.value("frequency") == pytest.approx(439.6, abs=0.05)
    assert found.mass == pytest.approx(0.0967, rel=1e-3)  # of {k, omega_n}
    assert found.damping == pytest.approx(2.0 * found.printed_damping, rel=1e-12)


@pytest.mark.no_cover
def test_ring_down_scatters_as_its_standard_error_says():
    fits = [ring_down(sigma=0.02, seed=s) for s in range(200)]
    decay = np.array([f.fit.value("decay") for f in fits])
    told = np.mean([f.fit.standard_error("decay") for f in fits])
    assert told == pytest.approx(decay.std(ddof=1), rel=0.15)  # 3 sigma of a scatter of 200
    assert abs(decay.mean() - 0.0824 * 441.1) < 4.0 * told / np.sqrt(200)


def test_ring_down_of_the_plant_gives_its_mass_and_damping():
    plant = HybridActuatorPlant(kernel="linear", magnet_force=0.0)
    m = plant.magnetics()
    out = np.empty((12000, 4))
    state = plant.initial_state()
    state[X] = -3.5e-3
    follow(state, plant.armature(), m, m, np.zeros((12000, 2)), 1e-5, False, out)
    found = fit_ring_down(np.arange(0.0, 12000.0, 10.0) * 1e-5, out[::10, 0], plant.spring_rate)
    assert found.mass == pytest.approx(plant.mass, rel=1e-5)
    assert found.damping == pytest.approx(plant.damping, rel=1e-5)
    assert found.natural_frequency == pytest.approx(380.7, rel=1e-4)
    assert found.damping_ratio == pytest.approx(0.036, rel=1e-3)


@pytest.mark.parametrize(
    ("t", "x", "spring", "message"),
    [
        (np.arange(50.0) * 1e-4, np.linspace(0, 1, 50), 1e4, "less than one oscillation"),
        (np.arange(40.0), np.cos(0.9 * np.pi * np.arange(40.0)), 1e4, "sampled every 1 s"),
        (np.arange(40.0), np.zeros(40), -1.0, "spring_rate = -1.0: must be a number above 0"),
    ],
)
def test_ring_down_refuses_what_is_none(t, x, spring, message):
    with pytest.raises(ValueError, match=message):
        fit_ring_down(t, x, spring)


def steps(voltages, sigma=0.0, seed=0, gap=2e-3, offset=0.0):
    plant = HybridActuatorPlant(kernel="linear", magnet_force=0.0, residual_gap=gap)
    a, m = plant.armature(), plant.magnetics()
    rng = np.random.default_rng(seed)
    records = []
    for voltage in voltages:
        state = np.zeros(STATE_SIZE)
        state[X] = a.travel
        current = [0.0]
        for _ in range(60):
            volts = np.tile([voltage, 0.0], (5, 1))
            follow(state, a, m, m, volts, 1e-5, True, np.empty((5, 4)))
            current.append(coil_current(m, state[FLUX_OPENER], gap))
        noisy = np.array(current) + offset + sigma * rng.standard_normal(61)
        records.append(StepRecord(np.arange(61.0) * 5e-5, noisy, voltage))
    return records, 2.0 * plant.beta / (gap + plant.kappa)


def test_current_steps_give_resistance_and_inductance():
    records, inductance = steps((12.0, 24.0))
    fit = fit_steps(records)
    assert fit.value("resistance") == pytest.approx(0.34, rel=1e-6)
    assert fit.value("inductance") == pytest.approx(inductance, rel=1e-6)


def test_current_steps_with_the_noise_of_the_sensor_keep_one_percent():
    """0.26 A (equations.md 1.1): the resistance within 1 %, inside its interval, 20 seeds."""
    off = []
    for seed in range(20):
        records, inductance = steps((12.0, 24.0), 0.26, seed)
        fit = fit_steps(records)
        assert fit.value("resistance") == pytest.approx(0.34, rel=0.01)
        assert fit.value("inductance") == pytest.approx(inductance, rel=0.02)
        off.append((fit.value("resistance") - 0.34) / fit.standard_error("resistance"))
    assert np.abs(off).max() < 4.0
    assert np.mean(np.abs(off) < 2.0) >= 0.8


def test_a_current_offset_is_local():
    records, _ = steps((24.0,), offset=0.64)
    fit = fit_steps(records, offsets=True)
    assert fit.value("offset[0]") == pytest.approx(0.64, rel=1e-6)
    assert fit.value("resistance") == pytest.approx(0.34, rel=1e-6)


def test_refuses_steps_that_are_none():
    with pytest.raises(ValueError, match=r"voltage = 0\.0"):
        fit_steps([StepRecord(np.arange(5.0), np.ones(5), 0.0)])
    with pytest.raises(ValueError, match="the current stayed at 0"):
        fit_steps([StepRecord(np.arange(5.0), np.zeros(5), 12.0)])


def test_intervals_of_a_ring_down_hold_the_mass_as_often_as_they_say():
    """95 % of 60 draws at 3 um of noise; three standard errors: 8 misses."""
    t = np.arange(0.0, 0.15, 2e-4)
    omega, ratio = 380.74, 0.036
    true = 3e-3 * np.exp(-ratio * omega * t) * np.cos(omega * np.sqrt(1.0 - ratio**2) * t)
    hits = 0
    for seed in range(60):
        noisy = true + 3e-6 * np.random.default_rng(seed).standard_normal(len(t))
        result = bench_fits.ring_down({"time": t, "position": noisy}, {"spring_rate": 18820.0})
        (mass,) = (v for v in result.values if v.name == "mass")
        hits += mass.lower <= 18820.0 / omega**2 <= mass.upper
    assert hits >= 52


def test_a_force_record_needs_curves():
    columns = {"gap": GAPS, "force": 1.0 / GAPS, "current": np.arange(len(GAPS), dtype=float)}
    with pytest.raises(ValueError, match="current = 0 A: 1 forces; a curve needs 3 or more"):
        bench_fits.static_force(columns, {"kernel": "saturating"})
    columns["current"] = np.full(len(GAPS), 5.0)
    with pytest.raises(ValueError, match="one current, 5 A: a kernel that saturates needs two"):
        bench_fits.static_force(columns, {"kernel": "saturating"})
