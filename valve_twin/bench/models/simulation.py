# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The simulated valve and the prediction against real time and a Python loop."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.bench.measure import Ratio, Scale, median, require_equal
from valve_twin.core.simulation import SimulatedValve, simulate_cycles, to_frames
from valve_twin.core.valves.press_cartridge.predictor import predict_block
from valve_twin.core.valves.registry import complete_options, get_model, get_simulation

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from valve_twin.core.types import FloatArray, Frames


def compare(scale: Scale) -> Iterator[Ratio]:
    """Yield the comparisons of this area."""
    yield _simulation(scale.repeats)
    yield _prediction(scale.repeats)
    yield _stiff_loop(scale.repeats)


def _simulation(repeats: int) -> Ratio:
    """Compare the CPU time of a production cycle of the press valve with its length."""
    config = get_simulation("press_cartridge")
    valve = SimulatedValve(config, seed=1)
    ours = median(lambda: valve.advance(config.cycle_samples), repeats)
    return Ratio("simulated press valve", "real time", ours, config.program.duration_s, 100.0)


def _prediction(repeats: int) -> Ratio:
    """One-step prediction and free run of 200 samples: compiled against the same Python loop."""
    config = get_simulation("press_cartridge")
    (block,) = simulate_cycles(config, 1, seed=1)
    frames = to_frames(block)[:200]
    model = get_model("press_cartridge")
    values = {"pole": 0.6, "K_in": 0.0098, "K_out": 0.045, "leak": 1e-3}
    options = complete_options(model, {})
    coefficients = model.coefficients(values, 2, config.period_s, options)
    loop: Callable[..., None] = predict_block.py_func  # type: ignore[attr-defined]
    ours = _predicted(predict_block, frames, coefficients, model.initial_state())
    peer = _predicted(loop, frames, coefficients, model.initial_state())
    require_equal(ours, peer, "predictions", "the Python loop")
    return Ratio(
        "prediction of 200 samples",
        "a Python loop",
        median(
            lambda: _predicted(predict_block, frames, coefficients, model.initial_state()),
            20 * repeats,
        ),
        median(lambda: _predicted(loop, frames, coefficients, model.initial_state()), repeats),
        50.0,
    )


def _predicted(
    kernel: Callable[..., None], frames: Frames, coefficients: FloatArray, state: FloatArray
) -> FloatArray:
    out = np.empty((2, len(frames)))
    codes = np.zeros((2, len(frames)), dtype=np.uint8)
    inputs = np.ascontiguousarray(frames.inputs)
    kernel(state, coefficients, frames.position, inputs, codes[0], out[0], out[1], codes[1])
    return out


def _stiff_loop(repeats: int) -> Ratio:
    """Compare compiled RODAS with scipy's BDF over 1 s of the servosystem, a step of 10 mm.

    Both at the accuracy of BDF at a relative tolerance of 1e-6, against RODAS at 1e-9; the peer's
    right-hand side is plain Python on floats, which for 13 states is faster than numpy.
    """
    from scipy.integrate import solve_ivp

    from valve_twin.bench.models.servo_peer import loop
    from valve_twin.core.physics.hysteresis import PLAYS
    from valve_twin.core.valves.servo_system import dynamics, integrate
    from valve_twin.core.valves.servo_system.plant import ServoSystemPlant

    plant, samples = ServoSystemPlant(hysteresis_width=0.0), 100
    p, memory, start = plant.numbers(), np.zeros(PLAYS), np.zeros(dynamics.STATES)
    integrate.rest(0.0, p, start, memory)
    act = np.array([0.01, np.nan, 0.0, 0.0])
    floor = dynamics.FLOOR

    def ours(rtol: float) -> FloatArray:
        out = np.empty((samples, dynamics.STATES))
        y, kept = start.copy(), memory.copy()
        integrate.span(y, kept, p, act, 1.0 / samples, integrate.FIRST_STEP, rtol, out)
        return out

    def peer() -> FloatArray:
        times = np.arange(1, samples + 1) / samples
        bdf = solve_ivp(
            loop(plant, 0.01), (0.0, 1.0), start, "BDF", times, rtol=1e-6, atol=1e-6 * floor
        )
        found: FloatArray = bdf.y.T
        return found

    exact = ours(1e-9)

    def error(found: FloatArray) -> float:
        return float(np.abs((found - exact) / (floor + np.abs(exact))).max())

    allowed, rtol = error(peer()), 1e-4
    while error(ours(rtol)) > allowed and rtol > 1e-8:
        rtol *= 0.7
    return Ratio(
        "stiff simulation of the servosystem, 1 s",
        "scipy's BDF of the same accuracy with a Python right-hand side",
        median(lambda: ours(rtol), 5 * repeats),
        median(peer, repeats),
        80.0,
    )
