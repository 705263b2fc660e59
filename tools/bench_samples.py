#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Write samples/bench from the simulated valves: tools/run python tools/bench_samples.py."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.simulation.plant import Drive
from valve_twin.core.valves.double_solenoid.dynamics_fit import filtered, trapezoid
from valve_twin.core.valves.double_solenoid.plant import DoubleSolenoidPlant
from valve_twin.core.valves.double_solenoid.plant_kernel import SAMPLE_S, STEP_S
from valve_twin.core.valves.hybrid_actuator.magnetics import coil_current
from valve_twin.core.valves.hybrid_actuator.plant import HybridActuatorPlant
from valve_twin.core.valves.hybrid_actuator.plant_kernel import FLUX_OPENER, STATE_SIZE, X, follow
from valve_twin.core.valves.hybrid_actuator.static_force import forces
from valve_twin.core.valves.servo_system.loops import sine_response
from valve_twin.core.valves.servo_system.plant import ServoSystemPlant

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import FloatArray

FOLDER = Path(__file__).resolve().parents[1] / "samples" / "bench"
SEED = 1
ACTUATOR = HybridActuatorPlant(kernel="linear", magnet_force=0.0, residual_gap=0.5e-3)


def static_force(rng: np.random.Generator) -> tuple[str, FloatArray]:
    """Return forces over the gap at four currents, load cell noise 0.56 N."""
    m = replace(ACTUATOR, kernel="saturating").magnetics()
    gap = np.arange(0.5e-3, 4.01e-3, 0.25e-3)
    rows = []
    for current in (5.0, 12.5, 25.0, 40.0):
        force = forces(m, gap, np.full(len(gap), current)) + 0.56 * rng.standard_normal(len(gap))
        rows.append(np.column_stack([1e3 * gap, force, np.full(len(gap), current)]))
    return "gap_mm,force_N,current_A", np.vstack(rows)


def ring_down(rng: np.random.Generator) -> tuple[str, FloatArray]:
    """Return the free oscillation of the armature from 3 mm, sensor noise 3 um."""
    step, count = 1e-4, 1500
    state = np.zeros(STATE_SIZE)
    state[X] = 3e-3
    out, m = np.empty((count, 4)), ACTUATOR.magnetics()
    follow(state, ACTUATOR.armature(), m, m, np.zeros((count, 2)), step, False, out)
    position = 1e3 * out[:, 0] + 3e-3 * rng.standard_normal(count)
    return "time_ms,position_mm", np.column_stack([1e3 * step * np.arange(count), position])


def current_steps(rng: np.random.Generator) -> tuple[str, FloatArray]:
    """Return currents after 12 and 24 V on an armature held at 0.5 mm, sensor noise 0.05 A."""
    step, count = 1e-5, 300
    a, m, rows = ACTUATOR.armature(), ACTUATOR.magnetics(), []
    for volts in (12.0, 24.0):
        state, current = np.zeros(STATE_SIZE), np.empty(count)
        state[X] = a.travel
        for n in range(count):
            follow(state, a, m, m, np.array([[volts, 0.0]]), step, True, np.empty((1, 4)))
            current[n] = coil_current(m, state[FLUX_OPENER], ACTUATOR.residual_gap)
        time_ms = 1e3 * step * (1.0 + np.arange(count))
        noisy = current + 0.05 * rng.standard_normal(count)
        rows.append(np.column_stack([time_ms, noisy, np.full(count, volts)]))
    return "time_ms,current_A,voltage_V", np.vstack(rows)


def hysteresis_loop(rng: np.random.Generator) -> tuple[str, FloatArray]:
    """Return valve position under five periods of current at 0.105 Hz, sensor noise 0.2 um."""
    current, position = sine_response(ServoSystemPlant(), 0.105, 0.06, periods=5)
    every = len(current) // 2000
    current, position = current[::every], position[::every]
    position = 1e6 * position + 0.2 * rng.standard_normal(len(position))
    return "current_mA,position_um", np.column_stack([1e3 * current, position])


def dynamics(rng: np.random.Generator) -> tuple[str, FloatArray]:
    """Return force of the curves and force behind G_F under a trapezoid, every 25 us."""
    source = trapezoid(0.6e-3, 8.0, 2e-3) - 1.0
    answer = filtered(DoubleSolenoidPlant().force_dynamics(), source)
    time_us = 1e6 * STEP_S * np.arange(len(source))
    noisy = answer + 0.02 * rng.standard_normal(len(answer))
    return "time_us,input_N,output_N", np.column_stack([time_us, source, noisy])[::2]


def steps(rng: np.random.Generator) -> tuple[str, FloatArray]:
    """Return three steps of the setpoint under trajectory set control, noise 0.16 um."""
    plant, count = replace(DoubleSolenoidPlant(), control="trajectory_set"), 1000
    wanted = np.full(count, 0.5)
    for start, level in ((100, 0.75), (400, 0.25), (700, 0.5)):
        wanted[start:] = level
    drive = Drive(wanted, np.ones(count, dtype=np.bool_), None, np.zeros(count))
    found = plant.run(plant.initial_state(), drive, SAMPLE_S).position
    scale = 2e3 * plant.half_stroke
    position = scale * (found - 0.5) + 1.6e-4 * rng.standard_normal(count)
    time_ms = 1e3 * SAMPLE_S * np.arange(count)
    return "time_ms,setpoint_mm,position_mm", np.column_stack(
        [time_ms, scale * (wanted - 0.5), position]
    )


SAMPLES = {
    "static-force": static_force,
    "ring-down": ring_down,
    "current": current_steps,
    "hysteresis-loop": hysteresis_loop,
    "dynamics": dynamics,
    "step": steps,
}


def main(names: Sequence[str] = tuple(SAMPLES)) -> None:
    """Write all samples."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in names:
        header, rows = SAMPLES[name](np.random.default_rng(SEED))
        path = FOLDER / f"{name}.csv"
        np.savetxt(path, rows, "%.6g", ",", header=header, comments="")
        print(f"{path}: {len(rows)} rows")


if __name__ == "__main__":
    main()
