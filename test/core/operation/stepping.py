# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Steps of simulated valves with known metrics: a fine motion, sampled coarsely with noise."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from valve_twin.core.operation.step_metrics import measure_steps
from valve_twin.core.operation.way import END, LEAST_SAMPLES
from valve_twin.core.simulation.plant import Drive
from valve_twin.core.types import Cycle, Frames
from valve_twin.core.valves.positioner.plant import PositionerPlant
from valve_twin.core.valves.registry import get_simulation

FINE_S = 1e-3
START_NS = 10**12


class Stepped(NamedTuple):
    """A cycle of steps, and by step what its metrics are without noise."""

    cycle: Cycle
    truth: list[dict[str, float]]


def make_cycle(time_s, position, inputs, number=7):
    """Return a cycle of samples."""
    n = len(time_s)
    columns = np.reshape(np.asarray(inputs, dtype=float), (n, -1))
    return Cycle(
        number,
        float(np.median(np.diff(time_s))),
        Frames(
            stamp_ns=START_NS + np.round(1e9 * np.asarray(time_s)).astype(np.int64),
            position=np.asarray(position, dtype=float),
            inputs=columns,
            counter=np.full(n, np.nan),
            reference=np.full(n, np.nan),
            valid=np.ones(n, dtype=bool),
        ),
    )


def plant_of(kind, rng):
    """Return a random valve of a kind and the longest time that it needs to settle [s]."""
    if kind == "first_order":
        lag = rng.uniform(0.15, 0.6)
        numbers = {"time_constant": lag, "dead_band": rng.uniform(0.0, 0.02)}
        plant: Any = get_simulation("first_order").plant
        return plant.__class__(**numbers), 8.0 * lag
    rates, slews = rng.uniform(3.0, 12.0, 2), rng.uniform(0.4, 2.0, 2)
    common = {
        "rate_rising": rates[0],
        "rate_falling": rates[1],
        "slew_rising": slews[0],
        "slew_falling": slews[1],
        "dead_band": rng.uniform(0.0, 0.01),
        "delay": round(rng.uniform(0.02, 0.3), 3),
        "step": FINE_S,
    }
    settle = 0.3 + 0.8 / slews.min() + 8.0 / rates.min()
    if kind == "positioner":
        return PositionerPlant(**common), settle
    lag = rng.uniform(0.8, 1.5) / rates.max()  # makes it pass its target
    more = {"velocity_lag": lag, "static_gain": rng.uniform(0.8, 1.1), "stiction": 0.003}
    return PositionerPlant(**(common | more)), settle + 12.0 * lag


def step_valve(kind, seed, *, together, coarse_ms=(2, 13), noise_log=(-3.5, -2.3)):
    """Return a stepped cycle of a random valve with random noise, sampling and steps.

    `together`: command and position are sampled by one clock; else the command comes anywhere
    between two samples. `coarse_ms`, `noise_log`: ranges of the period [ms] and of the decimal
    logarithm of the noise's standard deviation.
    """
    rng = np.random.default_rng([seed, *kind.encode(), together])
    plant, settle = plant_of(kind, rng)
    coarse = int(rng.integers(*coarse_ms))
    hold = rng.uniform(1.3, 2.0) * settle / FINE_S
    phase = int(rng.integers(coarse))
    count = 4
    at = [round(hold * (k + 1) + rng.uniform(0.0, 100.0)) for k in range(count)]
    if together:
        at = [n - n % coarse + phase for n in at]
    levels, u = [rng.uniform(0.1, 0.9)], np.empty(round(hold * (count + 1)))
    while len(levels) <= count:
        level = rng.uniform(0.05, 0.9)
        if abs(level - levels[-1]) > 0.1:
            levels.append(level)
    for first, last, level in zip([0, *at], [*at, len(u)], levels, strict=True):
        u[first:last] = level
    still = np.zeros(len(u))
    drive = Drive(still, still == 0.0, u[:, None], still)
    state = plant.initial_state()
    begin = np.full(round(3.0 * settle / FINE_S), levels[0])
    calm = np.zeros(len(begin))
    plant.run(state, Drive(calm, calm == 0.0, begin[:, None], calm), FINE_S)
    x = plant.run(state, drive, FINE_S).position
    noise = 10.0 ** rng.uniform(*noise_log)
    seen = np.arange(phase, len(u), coarse)
    measured = x[seen] + noise * rng.standard_normal(len(seen))
    edges = [0, *at, len(u)]
    truth = [
        step_truth(x, u, (edges[k], edges[k + 1], edges[k + 2]), coarse) for k in range(count)
    ]
    return Stepped(make_cycle(FINE_S * seen, measured, u[seen]), truth)


def step_truth(x, u, edges, coarse):
    """Return the metrics of a motion without noise."""
    before, begin, end = edges
    first = max(round(END * (begin - before)), LEAST_SAMPLES * coarse)
    last = max(round(END * (end - begin)), LEAST_SAMPLES * coarse)
    start, held = x[begin - first : begin].mean(), x[end - last : end].mean()
    way = (x[begin:end] - start) / (held - start)

    def passed(level):
        k = int((way > level).argmax())
        return FINE_S * (k - (way[k] - level) / (way[k] - way[k - 1]))

    return {
        "dead_time": 1.5 * passed(0.1) - 0.5 * passed(0.3),
        "t63": passed(0.63),
        "t86": passed(0.86),
        "overshoot": max(float(way.max()) - 1.0, 0.0),
        "travel_gain": (held - start) / (u[begin] - u[begin - 1]),
        "breakaway": passed(0.05),
    }


def score(kind, seeds, *, together, **ranges):
    """Return by metric: how many are told, covered, refused; and the refusals by their reason."""
    told: dict[str, int] = {}
    covered: dict[str, int] = {}
    reasons: dict[str, list[str]] = {}
    for seed in seeds:
        cycle, truth = step_valve(kind, seed, together=together, **ranges)
        for step, known in zip(measure_steps(cycle, ("command",)), truth, strict=True):
            for m in step.metrics:
                if m.reason:
                    reasons.setdefault(m.name, []).append(m.reason)
                    continue
                name = m.name
                if name == "overshoot" and m.lower_95 == 0.0:
                    name = "no overshoot"
                told[name] = told.get(name, 0) + 1
                inside = m.lower_95 <= known[m.name] <= m.upper_95
                covered[name] = covered.get(name, 0) + inside
    return told, covered, reasons
