# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compile every kernel once, at installation, so that no node compiles in a callback.

Runs one short record of each valve through simulation, twin, estimation and aging; numba keeps
what it compiled. `python -m valve_twin.warmup` does so for every valve, with `--demo [VALVE]` for
what the demo of one valve needs; a node whose valve was left out compiles when it is configured.
"""

from __future__ import annotations

import time
from contextlib import contextmanager, suppress
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np
from numba.core import event

from valve_twin.core.alignment import SignalRange
from valve_twin.core.cycle_config import CycleConfig
from valve_twin.core.twin import Twin, TwinConfig
from valve_twin.core.types import Cycle, CycleRule, Frames
from valve_twin.core.valves.registry import (
    complete_options,
    get_model,
    get_simulation,
    model_names,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.valves.interface import Options, ValveModel


class Compiled(event.Listener):
    """What was compiled because no cache held it."""

    def __init__(self) -> None:
        self.kernels = 0
        self.wall_s = 0.0

    def on_start(self, _event: event.Event) -> None:
        """Count a kernel that is compiled."""
        self.kernels += 1

    def on_end(self, _event: event.Event) -> None:
        """Take the end of a compilation; a kernel's own ones lie inside it."""

    def __str__(self) -> str:
        return (
            f"{self.kernels} numerical kernels were not compiled yet: compiled in "
            f"{self.wall_s:.1f} s and kept; make setup does it ahead"
        )


@contextmanager
def compiled() -> Iterator[Compiled]:
    """Count what is compiled inside."""
    found, begin = Compiled(), time.perf_counter()
    with event.install_listener("numba:compile", found):
        yield found
    found.wall_s = time.perf_counter() - begin


def main(argv: Sequence[str] | None = None) -> None:
    """Compile everything, or what the demo of one valve needs.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments, default `sys.argv[1:]`.
    """
    import argparse  # a twin runs what stands here, too, and needs a megabyte less without it

    from valve_twin.core.aging.cutting import ahead

    parser = argparse.ArgumentParser(prog="python -m valve_twin.warmup", description=__doc__)
    parser.add_argument("--demo", metavar="VALVE", nargs="?", const="")
    demo = parser.parse_args(argv).demo
    import_module("valve_twin.io.cdr.columns_kernel")  # compiles on import
    if demo is not None:
        _warm_up_demo(demo)
    else:
        _warm_up_all()
    ahead.warm_up()


def _warm_up_demo(valve: str) -> None:
    from valve_twin.core.valves.registry import DEFAULT_MODEL
    from valve_twin.demo.cases import find_case

    with suppress(ValueError):  # an unknown valve is told by the demo
        case = find_case(valve or DEFAULT_MODEL)
        for rule in CycleRule:
            run_once(case.model, rule)
        predict_once(case.model, CycleRule.WINDOW)  # the short records end before a prediction
        _simulate_shown(case.model)


def _warm_up_all() -> None:
    rules = list(CycleRule)
    for name in model_names():
        model = get_model(name)
        with suppress(ValueError):  # a user's model may want other parameters
            predict_once(name, CycleRule.WINDOW)  # the short records end before a prediction
        if model.simulation() is None:
            _estimate_wave(model, {})
        else:
            for rule in rules:
                run_once(name, rule)
            rules = rules[:1]  # cutting is the same for every valve
        for changed in model.variants:
            _estimate_wave(model, changed)
        if model.demonstration.file:
            _simulate_shown(name)
    if find_spec("skfem"):  # of the extra for design
        _warm_up_design()
    if find_spec("asyncua"):  # of the extra for the gateway
        import_module("valve_twin.gateway.opcua.standard").keep()


def _simulate_shown(name: str) -> None:
    """Simulate two samples of the file by which a valve is shown: its plant may be another."""
    from valve_twin.demo.cases import shown_file
    from valve_twin.io.config.valve import load_config
    from valve_twin.io.offline.simulated_bag import simulation_of

    simulate_once(simulation_of(load_config(shown_file(name))[0]))


def _warm_up_design() -> None:
    from valve_twin.design.field import make_model, solve_field
    from valve_twin.design.geometry import DoubleStroke

    solve_field(make_model(DoubleStroke().section(), 0.3), (1.0, 0.0))


def run_once(name: str, rule: CycleRule, options: Options | None = None) -> None:
    """Run a short record of one valve through everything; a worker does so before its first job.

    Parameters
    ----------
    name : str
        Name of the model.
    rule : CycleRule
        Rule that cuts the record.
    options : dataclass, optional
        Options that are not the default: they may need kernels and packages of their own.

    Raises
    ------
    ValueError
        If the model is unknown or cannot be simulated.
    """
    from valve_twin.core.estimation.cycle.scatter import MIN_CYCLES, scatter_between_cycles
    from valve_twin.core.estimation.cycle.sequence import estimate_cycle
    from valve_twin.core.operation.counters import Counters, cycle_duty
    from valve_twin.core.simulation import SimulatedValve

    model = get_model(name)
    simulation = get_simulation(name)
    options = model.options if options is None else options
    twin = _twin(model, rule, simulation.period_s)
    block = SimulatedValve(simulation, seed=0).advance(4 * simulation.cycle_samples)
    columns = dict(zip(model.inputs, block.inputs.T, strict=True))
    columns |= {"cycle_counter": block.cycle.astype(float), "reference": block.reference}
    columns |= {model.output: block.position}
    for signal, values in columns.items():
        twin.push(signal, block.stamp_ns, np.ascontiguousarray(values))
    counters = Counters()
    while (job := twin.next_job()) is not None:
        twin.deliver(*estimate_cycle(model, options, job.cycle, job.memory))
        duty = cycle_duty(job.cycle, normalised=model.normalised)
        counters = counters if duty is None else counters.after(duty)
    twin.finish()
    scatter_between_cycles(np.arange(float(MIN_CYCLES)))  # the record has fewer cycles


def simulate_once(simulation: SimulationConfig) -> None:
    """Simulate two samples; the node of a simulated valve does so before its first sample."""
    from valve_twin.core.simulation import SimulatedValve

    commands = np.zeros((2, len(simulation.plant.inputs)))
    external = simulation.controller == "external"
    SimulatedValve(simulation, seed=0).advance(2, commands if external else None)


def predict_once(name: str, rule: CycleRule) -> None:
    """Run two samples of rest through the twin; a node does so before its first sample.

    Parameters
    ----------
    name : str
        Name of the model.
    rule : CycleRule
        Rule that cuts the record.

    Raises
    ------
    ValueError
        If the model is unknown.
    """
    model = get_model(name)
    period_s, count = 0.03, 2
    twin, options = _twin(model, rule, period_s), complete_options(model, {})
    stamps = round(1e9 * period_s) * np.arange(1, count + 1)
    names = (*model.inputs, "cycle_counter", "reference", model.output)
    twin.push_round([(signal, stamps, np.zeros(count)) for signal in names])
    values = {p.name: 0.1 for p in model.parameters}
    for changed in ({}, *model.variants):
        model.predict(
            model.initial_state(),
            model.coefficients(values, 1, period_s, replace(options, **changed)),
            np.zeros(count),
            np.zeros((count, len(model.inputs))),
            np.zeros(count, dtype=np.uint8),
            np.empty(count),
            np.empty(count),
            np.empty(count, dtype=np.uint8),
        )


def _estimate_wave(model: ValveModel, changed: Mapping[str, object]) -> None:
    """Estimate a made-up cycle for kernels that no simulation reaches: output follows command."""
    from valve_twin.core.estimation.cycle.memory import Memory
    from valve_twin.core.estimation.cycle.sequence import estimate_cycle

    period_s, count = 0.1, 200
    wave = np.sin(0.2 * np.arange(count))
    wave = 0.5 + 0.4 * wave if changed else wave  # a positioner's position is in 0..1
    frames = Frames(
        stamp_ns=round(1e9 * period_s) * np.arange(1, count + 1),
        position=wave,
        inputs=np.tile(np.roll(wave, -2 if changed else 0)[:, None], (1, len(model.inputs))),
        counter=np.full(count, np.nan),
        reference=np.full(count, np.nan),
        valid=np.ones(count, dtype=np.bool_),
    )
    cycle = Cycle(1, period_s, frames)
    estimate_cycle(model, complete_options(model, changed), cycle, Memory.empty())


def _twin(model: ValveModel, rule: CycleRule, period_s: float) -> Twin:
    config = TwinConfig(
        period_s=period_s,
        signals=tuple(SignalRange(s) for s in (model.output, *model.inputs)),
        counter=SignalRange("cycle_counter"),
        reference=SignalRange("reference"),
        cycles=CycleConfig(rule=rule, window_s=30.0),
        options=complete_options(model, {}),
    )
    return Twin(config, model)


if __name__ == "__main__":
    main()
