# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A designed double-stroke solenoid in this valve: its numbers, steps in its position loop."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.physics.curves import force_of
from valve_twin.core.quantity import replaced
from valve_twin.core.valves.designed import Loop, Numbers
from valve_twin.core.valves.double_solenoid import plant_kernel as at
from valve_twin.core.valves.double_solenoid.control.kernel import decide
from valve_twin.core.valves.double_solenoid.control.observer import correct, follow
from valve_twin.core.valves.double_solenoid.plant import DoubleSolenoidPlant
from valve_twin.core.valves.double_solenoid.step_response import judge_step

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.physics.coenergy import CoenergyMap
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.designed import Designed, Wear

_EDDIES = tuple(f"eddies.{n}" for n in ("gain_1", "time_1", "gain_2", "time_2", "growth"))
_REST, _FOLLOWED = 50, 800  # control samples before and after a step
_REACHED = 600  # control samples in which it comes to rest at another start
_SEED = 0  # of the noise of the position
_PLACES = 33  # between middle and open port at which the force is looked at


def numbers_of(found: Designed) -> Numbers:
    """Return a designed solenoid's numbers by the names of the valve's options."""
    around, curves = found.around, found.curves
    b1, b2, a1, a2 = found.current_dynamics
    f1, f2, d1, d2 = found.force_dynamics
    source = f"{curves.provenance.get('name')}, sha256 {curves.provenance.get('sha256')}"
    shared: dict[str, object] = {
        "mass": found.mass,
        "spring_1": around.spring_rate,
        "spring_2": around.spring_rate,
        "preload_1": around.preload,
        "preload_2": around.preload,
        "friction": around.rubbing,
        "alpha": around.steepness,
        "beta": around.viscous,
        "resistance_a": found.resistance,
        "resistance_b": found.resistance,
        "half_stroke": around.opened * found.stroke,
        "end_stop": found.stroke,
        "supply_voltage": around.supply,
        "current_b1": b1,
        "current_b2": b2,
        "current_a1": a1,
        "current_a2": a2,
        "force_f1": f1,
        "force_f2": f2,
        "force_d1": d1,
        "force_d2": d2,
        **dict(zip(_EDDIES, found.eddies, strict=False)),
        **map_lists(curves),
        "map_source": source,
    }
    own: dict[str, object] = {
        "control": "trajectory_set",
        "bias_current": around.bias,
        "span_current": around.span,
        "largest_current": found.largest_current,
        "trajectory_set.overshoot": around.overshoot,
        "trajectory_set.speed_time": around.speed_time,
        "trajectory_set.effort": around.effort,
        "trajectory_set.change": around.change,
        "trajectory_set.small": around.small,
        "trajectory_set.sizes": around.sizes,
        "trajectory_set.horizon": around.horizon,
    }
    return Numbers(shared, own)


def map_lists(curves: CoenergyMap) -> dict[str, tuple[float, ...]]:
    """Return a map as the valve's options hold it."""
    return {
        "map_current": tuple(curves.currents.tolist()),
        "map_position": tuple(curves.positions.tolist()),
        "map_coenergy": tuple(curves.coefficients.ravel().tolist()),
    }


def doubt_lists(doubts: Sequence[Wear]) -> dict[str, object]:
    """Return doubts about a map, on its nodes, as the twin's options hold them."""
    values = (v for of in doubts for v in of.change.coefficients.ravel().tolist())
    return {
        "map_doubt_names": tuple(of.name for of in doubts),
        "map_doubt": tuple(float(f"{v:.4g}") for v in values),
    }


def plant_of(numbers: Numbers) -> DoubleSolenoidPlant:
    """Return the simulated valve of a design.

    Raises
    ------
    ValueError
        If a number is outside its range or does not fit the others; it names the number.
    """
    return replaced(DoubleSolenoidPlant(), {**numbers.shared, **numbers.own})


def follow_step(
    numbers: Numbers,
    share: float,
    changes: Mapping[str, float],
    start: float = 0.0,
    draw: int = _SEED,
) -> Loop:
    """Follow a step of the setpoint for 80 ms; see `Designable.loop`.

    The controllers keep the model of the design and know the supply: what else changes is the
    valve's alone. They read position and currents through the sensors of the simulated valve.

    Parameters
    ----------
    numbers : Numbers
        Of the valve.
    share : float
        End of the step over half the stroke, -1..1, not the start [1].
    changes : mapping
        Factors of friction, supply and copper [1].
    start : float
        Where the valve rests before it, likewise [1].
    draw : int
        Seed of the noise of the position.

    Raises
    ------
    ValueError
        If the integration fails; says when and where.
    """
    plant = plant_of(numbers)
    v, m, weights = plant.valve(), plant.tables(), plant.trajectory_set.weights()
    copper = changes.get("copper", 1.0)
    real = v._replace(
        friction=v.friction * changes.get("rubbing", 1.0),
        resistance_a=v.resistance_a * copper,
        resistance_b=v.resistance_b * copper,
    )
    gains = plant.current_gains()
    gains = gains._replace(supply=gains.supply * changes.get("supply", 1.0))
    observer = plant.observer.numbers(float(plant.current_quantum), draw)
    state, o = np.split(plant.initial_state(), 2)
    rest = _REACHED if start else _REST
    work, states = o.copy(), np.empty((rest + _FOLLOWED + 1, len(state)))
    for n in range(len(states)):
        states[n] = state
        target = (share if n >= rest else start) * plant.half_stroke
        correct(o, v, m, observer, state, state[at.X])
        command = decide(o, v, m, gains, weights, target, work)
        at.control_sample(state, real, m, gains, command, False)
        follow(o, v, m, state)
    refusal = plant.failure(np.concatenate([state, o]))
    if refusal:
        raise ValueError(refusal)
    return _loop(plant, copper, (start, share), states[rest:])


def _loop(
    plant: DoubleSolenoidPlant, copper: float, ends: tuple[float, float], s: FloatArray
) -> Loop:
    time_s: FloatArray = at.SAMPLE_S * np.arange(len(s), dtype=np.float64)
    start, share = ends
    place = (s[:, at.X] - start * plant.half_stroke) / ((share - start) * plant.half_stroke)
    of = judge_step(time_s, place)
    heat = plant.resistance_a * s[:, at.MEAN_A] ** 2 + plant.resistance_b * s[:, at.MEAN_B] ** 2
    wanted = np.full(len(s), 1e3 * share * plant.half_stroke)
    rows: tuple[tuple[str, dict[str, FloatArray]], ...] = (
        ("voltage [V]", {"A": s[:, at.VOLTS_A], "B": s[:, at.VOLTS_B]}),
        ("flux linkage [mWb]", {"A": 1e3 * s[:, at.PSI_A], "B": 1e3 * s[:, at.PSI_B]}),
        ("current [A]", {"A": s[:, at.MEAN_A], "B": s[:, at.MEAN_B]}),
        ("u [1]", {"u": s[:, at.COMMAND]}),
        ("force [N]", {"F": s[:, at.FORCE]}),
        ("position [mm]", {"x": 1e3 * s[:, at.X], "wanted": wanted}),
    )
    error = abs(float(place[-1]) - 1.0)
    return Loop(
        time_s=time_s,
        rows=rows,
        rise_s=of.rise_s,
        overshoot=of.overshoot,
        settling_s=of.settling_s,
        graded_s=of.graded_s,
        error=error,
        loss=copper * float(heat.mean()),
    )


def margin_of(numbers: Numbers) -> float:
    """Return the least force that the largest current leaves on the way to an open port [N]."""
    plant = plant_of(numbers)
    tables, v = plant.tables(), plant.valve()
    places = np.linspace(0.0, plant.half_stroke, _PLACES)
    left = [
        v.force_gain * force_of(tables, v.largest, 0.0, float(x)) + at.spring_force(v, float(x))
        for x in places
    ]
    return float(min(left)) - 0.5 * plant.friction
