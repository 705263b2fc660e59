# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The generic model: what is estimated from one cycle and how it predicts."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.types import ParameterValue
from valve_twin.core.valves.hammerstein_wiener.fit import BLOCKS, Data, Fit, choose, refit
from valve_twin.core.valves.hammerstein_wiener.kernels import (
    INPUT,
    LAG,
    MEMORY,
    OUTPUT,
    RISE,
    SIZE,
    STATE_SIZE,
    A,
    B,
    free_run,
    predict_block,
)
from valve_twin.core.valves.hammerstein_wiener.parameters import (
    COEFFICIENTS,
    ESTIMATOR,
    FOLLOWED,
    NAMES,
    PARAMETERS,
    HammersteinWienerOptions,
)
from valve_twin.core.valves.hammerstein_wiener.plant import LAW, PROGRAM
from valve_twin.core.valves.hammerstein_wiener.shape import Shape
from valve_twin.core.valves.kit.compiled import CompiledModel
from valve_twin.core.valves.kit.outcome import Evidence, conclude, not_excited, refuse, unexcited
from valve_twin.core.valves.kit.plant import simulation_of
from valve_twin.core.valves.kit.record import take_record
from valve_twin.core.valves.kit.strangers import READ_OTHERWISE

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.types import Cycle, Estimate, FloatArray, Parameter
    from valve_twin.core.valves.kit.record import Record

_LOW, _HIGH = 1.0 / 6.0, 5.0 / 6.0  # of the command's range, between which the answer is judged
_REACHED = 1.0 - np.exp(-1.0)  # share of a step's answer that ends the response [1]
_LONGEST = 20_000  # samples in which a step has to settle
_MOST_MEMORY = 0.9999
_CHOICES = 2  # cycles in which blocks are chosen: the first may be short


@dataclass(frozen=True, slots=True)
class HammersteinWienerModel(CompiledModel):
    """Implements `ValveModel` for any command and any answer."""

    name: str = "hammerstein_wiener"
    inputs: tuple[str, ...] = ("command",)
    output: str = "position"
    parameters: tuple[Parameter, ...] = PARAMETERS
    options: HammersteinWienerOptions = field(default_factory=HammersteinWienerOptions)
    kernel = predict_block
    state_size = STATE_SIZE
    trend_estimator: str = ESTIMATOR
    proposed_for: str = "any"

    def estimate(
        self, cycle: Cycle, options: HammersteinWienerOptions, earlier: Sequence[Estimate] = ()
    ) -> tuple[Estimate, ...]:
        """Estimate the blocks from one cycle: chosen in the first two, then fitted anew.

        Parameters
        ----------
        cycle : Cycle
            One cycle of N samples.
        options : HammersteinWienerOptions
            The model's options.
        earlier : sequence of Estimate
            The newest of them says which blocks there are.

        Returns
        -------
        tuple of Estimate
            One estimate with the coefficients of the blocks that there are; REFUSED with its
            reason where the cycle says nothing.
        """
        record = take_record(cycle, max_lag=options.max_lag)
        refusal = _refusal(record, options)
        evidence = Evidence(record.counts)
        if refusal:
            return (refuse(self.name, ESTIMATOR, cycle, NAMES, refusal, evidence),)
        data = Data(np.ascontiguousarray(record.inputs[:, 0]), record.output, record.used)
        before = [e for e in earlier if e.estimator == ESTIMATOR and isfinite(e.value("memory"))]
        fit = _known(data, before[-1], options) if len(before) >= _CHOICES else None
        if fit is None:
            fit = choose(
                data, blocks=options.blocks, max_order=options.max_order, max_lag=options.max_lag
            )
        values = _values(fit, data, cycle.period_s)
        evidence = Evidence(record.counts, lag=fit.shape.lag)
        return (conclude(self.name, ESTIMATOR, cycle, values, unexcited(values), evidence),)

    def merge(self, estimates: Sequence[Estimate]) -> Mapping[str, float]:
        """Return the newest estimate alone: coefficients mean nothing without each other."""
        return {p.name: p.value for p in estimates[-1].parameters if isfinite(p.value)}

    def coefficients(
        self,
        values: Mapping[str, float],
        lag: int,
        period_s: float,
        options: HammersteinWienerOptions,
    ) -> FloatArray:
        """Return the (SIZE,) coefficients, as `ValveModel.coefficients` says.

        Blocks that no value tells of are not there.
        """
        del period_s, options
        needed = ("memory", "b1", "input_knots", "input_first", "input_last", "input_1", "input_2")
        if not all(name in values for name in needed):
            return np.full(SIZE, np.nan)
        c = np.zeros(SIZE)
        for name, (index, _) in COEFFICIENTS.items():
            c[index] = values.get(name, 0.0)
        c[LAG] = lag
        return c

    def strangers(self) -> Mapping[str, Mapping[str, object]]:
        """Return valves that are curved or read otherwise than the simulated one."""
        curves = {f"curvature {c:g}": {"plant.curvature": c} for c in (-0.3, 0.0, 0.8)}
        return {**curves, **READ_OTHERWISE}

    def truth(self, simulation: SimulationConfig, cycle: int) -> Mapping[str, float]:
        """Return gain and responses, parameters as `ValveModel.truth`.

        A response is that of the position as it is read: what reads it late is part of it.
        """
        known = dict(CompiledModel.truth(self, simulation, cycle))
        late = simulation.measurement.delay * simulation.period_s
        for name in ("response_rising", "response_falling"):
            known[name] += late
        return known

    def simulation(self) -> SimulationConfig:
        """Return the default simulation: a valve that is not of the model's own form."""
        return simulation_of(self.name, self.inputs, LAW, PROGRAM)


def _refusal(record: Record, options: HammersteinWienerOptions) -> str:
    n = int(np.count_nonzero(record.used))
    wanted = max(options.min_samples, 4 * options.max_lag)
    if n < wanted:
        text = f"{n} usable samples without a gap, fewer than {wanted} (min_samples)"
        return Refusal(RefusalCode.FEW_SAMPLES, text)
    if float(np.ptp(record.output[record.used])) == 0.0:
        text = f"the answer stayed at {record.output[0]:.4g}: the cycle shows nothing"
        return Refusal(RefusalCode.NO_MOTION, text)
    if float(np.ptp(record.inputs[:, 0])) == 0.0:
        text = f"the command stayed at {record.inputs[0, 0]:.4g}: the cycle excites nothing"
        return Refusal(RefusalCode.NOT_EXCITED, text)
    return ""


def _known(data: Data, newest: Estimate, options: HammersteinWienerOptions) -> Fit | None:
    """Fit the blocks of the newest estimate anew; None where the options allow others now."""
    c = MODEL.coefficients(MODEL.merge([newest]), newest.lag, 1.0, options)
    order = int(np.count_nonzero(c[A:B]))
    added = bool(c[RISE] > 0.0), bool(c[INPUT] > 2.0), bool(c[OUTPUT] > 0.0)
    shape = Shape(newest.lag, order, *added)
    allowed = all(
        name in options.blocks for name, there in zip(BLOCKS, added, strict=True) if there
    )
    if not allowed or order > options.max_order or newest.lag > options.max_lag:
        return None
    return refit(data, shape, c)


def _values(fit: Fit, data: Data, period_s: float) -> list[ParameterValue]:
    """Return what is published: coefficients of the blocks that there are, and what they mean."""
    c = fit.coefficients.copy()
    c[MEMORY] = _memory(c, data)
    gain, rising, falling = _responses(c, data, period_s)
    found = [
        ParameterValue(p.name, value)
        if isfinite(value)
        else not_excited(p.name, "the model does not settle after a step")
        for p, value in zip(FOLLOWED, (gain, rising, falling), strict=True)
    ]
    shape = fit.shape
    there = {A + i for i in range(shape.order)} | {B + i for i in range(max(shape.order, 1))}
    there |= {MEMORY, *range(INPUT, INPUT + 3 + shape.knots)}
    if shape.rates:
        there |= set(range(RISE, INPUT))
    if shape.bent:
        there |= set(range(OUTPUT, OUTPUT + 3 + int(c[OUTPUT])))
    return found + [
        ParameterValue(name, float(c[i])) for name, (i, _) in COEFFICIENTS.items() if i in there
    ]


def _memory(c: FloatArray, data: Data) -> float:
    """Return the share of the free run's error that stays from one sample to the next."""
    out = np.empty(len(data.y))
    free_run(c, data.u, float(data.y[0]), out)
    left = np.where(data.used, data.y - out, 0.0)
    power = float(left[:-1] @ left[:-1])
    share = float(left[1:] @ left[:-1]) / power if power > 0.0 else 0.0
    return min(max(share, 0.0), _MOST_MEMORY)


def _responses(c: FloatArray, data: Data, period_s: float) -> tuple[float, float, float]:
    """Return gain [1] and the times to 63 % of a rising and of a falling command [s]."""
    low, high = data.ranges.command
    edges = low + _LOW * (high - low), low + _HIGH * (high - low)
    times, ways = [], []
    for first, last in (edges, edges[::-1]):
        reached, way = _step_response(c, first, last)
        times.append(reached * period_s)
        ways.append(way)
    return ways[0] / (edges[1] - edges[0]), times[0], times[1]


def _step_response(c: FloatArray, first: float, last: float) -> tuple[float, float]:
    """Return after how many samples 63 % of a step's answer are reached, and its way."""
    n = 200
    while n <= _LONGEST:
        u = np.full(2 * n, last)
        u[:n] = first
        out = np.empty(2 * n)
        free_run(c, u, 0.0, out)
        begun, ended = out[n - 1], out[-1]
        way = float(ended - begun)
        settled = abs(out[-1 - n // 4] - ended) + abs(out[n - 1 - n // 4] - begun)
        if settled <= 1e-4 * abs(way) and np.isfinite(way) and way != 0.0:
            share = (out[n - 1 :] - begun) / way
            k = int(np.argmax(share >= _REACHED))
            before = share[k - 1]
            return k - 1 + float((_REACHED - before) / (share[k] - before)) - 1.0, way
        n *= 3
    return float("nan"), float("nan")


MODEL = HammersteinWienerModel()
