# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""All numbers of a simulation as a tree of frozen dataclasses, and how to override them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeVar, cast

from valve_twin.core.quantity import (
    assumed,
    check_quantities,
    describe,
    quantity,
    setting,
    suggest,
)
from valve_twin.core.simulation.faults import Faults
from valve_twin.core.simulation.measurement import MeasurementConfig
from valve_twin.core.simulation.program import CycleProgram

if TYPE_CHECKING:
    from collections.abc import Mapping

    from _typeshed import DataclassInstance

    from valve_twin.core.simulation.aging_laws import AgingRule
    from valve_twin.core.simulation.plant import Plant

CONTROLLERS = ("cycles", "external")

_HALVINGS = 30  # the share of a change is found to 1e-9

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Scatter:
    """A plant parameter that differs a little from cycle to cycle.

    Attributes
    ----------
    parameter : str
        Name of a plant parameter, e.g. "supply_pressure".
    sigma : float
        Relative standard deviation [1].
    """

    parameter: str
    sigma: float

    def __post_init__(self) -> None:
        """Refuse a scatter that is not a small fraction."""
        if not 0.0 <= self.sigma <= 0.5:
            message = f"scatter of {self.parameter} = {self.sigma!r}: must be from 0 to 0.5 [1]"
            raise ValueError(message)


@dataclass(frozen=True, slots=True)
class StartFault:
    """A fault that comes by itself."""

    kind: str = setting(
        "none",
        "Fault to start with: none, leak, stuck, sensor_freeze, lost_samples or what else the "
        "valve's plant takes",
    )
    severity: float = quantity(
        0.0,
        "1",
        "leak: loss of stroke [1/s]; lost_samples: probability; else as in docs/diagnosis.md [1]",
        -1.0,
        10.0,
    )
    start_s: float = quantity(0.0, "s", "Simulated time of its start", 0.0, 1e9)
    duration_s: float = quantity(0.0, "s", "How long it stays, 0 = until cleared", 0.0, 1e9)

    def __post_init__(self) -> None:
        """Refuse an unknown kind and values outside their range."""
        check_quantities(self)
        Faults().with_fault(self.kind, self.severity, 0, 0)


@dataclass(frozen=True, slots=True)
class FmuKeys:
    """A Functional Mock-up Unit in place of the plant."""

    file: str = setting(
        "",
        "FMU for co-simulation (FMI 2.0, 3.0) as the plant, a program: trusted files only; "
        "empty = the valve's own plant",
        local=True,
    )
    inputs: tuple[str, ...] = setting(
        (), "Its input variables, in the order of the valve's inputs; empty = of the same names"
    )
    output: str = setting(
        "", "Its variable that is measured; empty = of the name of the valve's output"
    )


@dataclass(frozen=True, slots=True)
class SimulationConfig:
    """Everything that fixes a simulated valve, together with a seed.

    Attributes
    ----------
    plant : Plant
        The valve and its local controller.
    program : CycleProgram
        The production cycle.
    measurement : MeasurementConfig
        What the sensor makes of the position.
    period_s : float
        Sampling time of position and commands [s].
    controller : str
        "cycles": runs production cycles by itself; "external": takes the commands from outside.
    first_cycle : int
        Number of the first cycle.
    start_command, rearm_command : int
        With external commands: a cycle starts when input `start_command` rises above `threshold`
        and `rearm_command` (-1 = none) has been above it since the last start.
    threshold : float
        Command level that counts as active [1].
    aging : tuple of AgingRule
        Plant parameters that age.
    scatter : tuple of Scatter
        Plant parameters that differ from cycle to cycle.
    fault : StartFault
        A fault that comes by itself.
    fmu : FmuKeys
        Where the plant is an FMU, which; `io.fmu.plant` puts it in.
    """

    plant: Plant
    program: CycleProgram = field(default_factory=CycleProgram)
    measurement: MeasurementConfig = field(default_factory=MeasurementConfig)
    period_s: float = assumed(0.03, "s", "Sampling time of position and commands", 1e-4, 10.0)
    controller: str = setting(
        "cycles",
        "cycles = run production cycles; external = take the command topics",
        choices=CONTROLLERS,
    )
    first_cycle: int = quantity(1, "1", "Number of the first cycle", 0, 2**53)
    start_command: int = quantity(
        0, "1", "External: index of the command that starts a cycle", 0, 31
    )
    rearm_command: int = quantity(
        -1, "1", "External: index of the command needed since the last start, -1 = none", -1, 31
    )
    threshold: float = quantity(0.02, "1", "External: command that counts as active", 0.0, 1.0)
    aging: tuple[AgingRule, ...] = ()
    scatter: tuple[Scatter, ...] = ()
    fault: StartFault = field(default_factory=StartFault)
    fmu: FmuKeys = field(default_factory=FmuKeys)

    def __post_init__(self) -> None:
        """Refuse values outside their range, unknown parameters and periods that do not fit."""
        check_quantities(self)
        self.plant.ticks_per_sample(self.period_s)
        samples = self.program.duration_s / self.period_s
        if abs(samples - round(samples)) > 1e-6:
            message = (
                f"program.duration_s = {self.program.duration_s!r}: "
                f"must be a whole multiple of period_s = {self.period_s!r} [s]"
            )
            raise ValueError(message)
        for name in [r.parameter for r in self.aging] + [s.parameter for s in self.scatter]:
            check_parameter(self.plant, name)
        inputs = len(self.plant.inputs)
        if len(self.measurement.command_offsets) not in {0, inputs}:
            message = (
                f"measurement.command_offsets = {self.measurement.command_offsets!r}: "
                f"must have {inputs} entries ({', '.join(self.plant.inputs)}) or none"
            )
            raise ValueError(message)
        if max(self.start_command, self.rearm_command) >= inputs:
            message = (
                f"start_command = {self.start_command!r}, rearm_command = {self.rearm_command!r}: "
                f"must be below the number of commands, {inputs}"
            )
            raise ValueError(message)

    @property
    def cycle_samples(self) -> int:
        """Return the number of samples of a production cycle."""
        return round(self.program.duration_s / self.period_s)

    def aged_plant(self, cycle: int) -> Plant:
        """Return the plant of a cycle, aged but not scattered."""
        return changed_plant(self.plant, {r.parameter: r.factor(cycle) for r in self.aging})

    def plant_numbers(self, cycle: int) -> dict[tuple[str, str], float]:
        """Return what may age of the plant by name and unit, as it is in a cycle."""
        known = describe(cast("DataclassInstance", self.aged_plant(cycle)))
        return {(d.name, d.unit): cast("float", d.default) for d in known if d.ages}


def check_parameter(plant: Plant, name: str) -> None:
    """Refuse what cannot age or scatter.

    Raises
    ------
    ValueError
        If the plant has no such parameter, naming the nearest; or if its value is 0, which no
        relative change moves.
    """
    known = [d.name for d in describe(cast("DataclassInstance", plant)) if d.ages]
    if name not in known:
        message = f"plant parameter '{name}' is unknown; {suggest(name, known)}"
        raise ValueError(message)
    if getattr(plant, name) == 0.0:
        message = (
            f"plant parameter '{name}' = 0: no relative change moves it; "
            f"give simulation.plant.{name} a value first"
        )
        raise ValueError(message)


def changed_plant(plant: Plant, factors: Mapping[str, float]) -> Plant:
    """Return the plant with parameters multiplied, each kept inside its allowed range.

    Where numbers that are allowed one by one make no valve together, such as edges that pass each
    other, the change stops at the last share of it that does.
    """
    if not factors:
        return plant
    node = cast("DataclassInstance", plant)
    known = {d.name: d for d in describe(node)}
    values = {}
    for name, factor in factors.items():
        lower, upper = known[name].lower, known[name].upper
        values[name] = min(max(getattr(plant, name) * factor, lower), upper)
    try:
        return cast("Plant", replace(node, **values))
    except ValueError:
        return cast("Plant", _as_far_as_it_is_one(node, values))


def _as_far_as_it_is_one(node: DataclassInstance, values: Mapping[str, float]) -> object:
    """Return the plant changed by the largest share of the change that leaves a valve."""
    best: object = node
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        share = 0.5 * (low + high)
        part = {n: (1.0 - share) * getattr(node, n) + share * v for n, v in values.items()}
        try:
            best, low = replace(node, **part), share
        except ValueError:
            high = share
    return best
