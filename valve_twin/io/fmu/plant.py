# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A simulated valve whose plant is an FMU: its parameters are the plant's numbers."""

from __future__ import annotations

from dataclasses import make_dataclass, replace
from typing import TYPE_CHECKING, ClassVar, cast

import numpy as np

from valve_twin.core.quantity import checked, quantity, replaced
from valve_twin.core.simulation.config import FmuKeys, SimulationConfig
from valve_twin.core.simulation.plant import Plant, Response
from valve_twin.core.simulation.settings import configure
from valve_twin.core.valves.registry import get_model, get_simulation
from valve_twin.io.errors import ConfigError
from valve_twin.io.fmu.unit import KEY, Unit

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.simulation.plant import Drive
    from valve_twin.core.types import FloatArray
    from valve_twin.io.fmu.unit import Instance, Variable

_OUTPUT, _TIME = 0, 1


class _Running(np.ndarray):
    """State of a simulated valve, output and time [s]; the FMU itself goes along."""

    instance: Instance
    values: dict[str, float]


class FmuPlant(Plant):
    """A plant that is an FMU; `plant_of` makes the dataclass of its parameters.

    A sample is a communication step: the inputs are set, held, and the output is read at its end.
    """

    fault_kinds: ClassVar[tuple[str, ...]] = ("sensor_offset", "sensor_gain", "command_loss")
    command_range: ClassVar[tuple[float, float]] = (-1e300, 1e300)
    unit: ClassVar[Unit]
    taken: ClassVar[tuple[Variable, ...]]
    output: ClassVar[Variable]
    parameters: ClassVar[tuple[Variable, ...]]

    def initial_state(self) -> FloatArray:
        """Return the (2,) state of a new instance: its output and the time, 0 [s]."""
        state = np.zeros(2).view(_Running)
        values = {v: float(getattr(self, v.name)) for v in self.parameters}
        state.instance = self.unit.start(values)
        state.values = {v.name: value for v, value in values.items()}
        state[_OUTPUT] = state.instance.get(self.output.reference, 0.0)
        return state

    def run(self, state: FloatArray, drive: Drive, period_s: float) -> Response:
        """Run N samples as `Plant.run` says. The commands are the reference itself."""
        assert isinstance(state, _Running)
        forcing = drive.forcing(len(self.inputs))
        out = Response.empty(len(drive.disturbance), len(self.inputs))
        self._tune(state)
        if drive.leak_rate or drive.disturbance.any():
            state.instance.failure = state.instance.failure or (
                f"{self.unit.path} takes neither a leak nor process noise: take out the fault "
                "'leak' and measurement.process_noise"
            )
        references = [v.reference for v in self.taken]
        for n in range(len(out.position)):
            out.position[n] = state[_OUTPUT]
            out.inputs[n] = forcing.commands[n] if forcing.external else forcing.reference[n]
            if state.instance.failure or forcing.stuck:
                continue
            time_s = float(state[_TIME])
            if not forcing.lost[n]:
                state.instance.set(references, [float(u) for u in out.inputs[n]], time_s)
            state.instance.step(time_s, period_s)
            state[_TIME] = time_s + period_s
            found = state.instance.get(self.output.reference, float(state[_TIME]))
            if not state.instance.failure:
                state[_OUTPUT] = found
        return out

    def failure(self, state: FloatArray) -> str:
        """Return when and how the FMU failed, empty if it did not."""
        return state.instance.failure if isinstance(state, _Running) else ""

    def _tune(self, state: _Running) -> None:
        """Give the FMU the parameters that have aged."""
        for v in self.parameters:
            value = float(getattr(self, v.name))
            if value != state.values[v.name]:
                state.instance.set([v.reference], [value], float(state[_TIME]))
                state.values[v.name] = value


def simulation_for(model: str, given: Mapping[str, object]) -> SimulationConfig:
    """Return the simulation of a valve with its settings; its plant is an FMU where one is named.

    Parameters
    ----------
    model : str
        Name of the valve's model, whose program and measurement are the default.
    given : mapping
        Settings by dotted name or nested, as `configure` takes them.

    Raises
    ------
    ValueError
        If a setting is unknown, of a wrong type or outside its range.
    ConfigError
        If the FMU cannot be used; one line.
    """
    return configure(default_simulation(model, fmu_keys(given)), given)


def fmu_keys(given: Mapping[str, object]) -> FmuKeys:
    """Return the keys of the FMU among settings by dotted name or nested; ValueError as above."""
    nested = given.get("fmu")
    own = dict(nested) if isinstance(nested, dict) else {}
    own |= {k.removeprefix("fmu."): v for k, v in given.items() if k.startswith("fmu.")}
    return replaced(FmuKeys(), checked(FmuKeys, own, where=f"{KEY}."))


def default_simulation(model: str, keys: FmuKeys) -> SimulationConfig:
    """Return the default simulation of a valve, with the FMU as its plant where one is named.

    Parameters
    ----------
    model : str
        Name of the valve's model.
    keys : FmuKeys
        File, input and output variables.

    Raises
    ------
    ConfigError
        If the FMU cannot be used; one line.
    """
    simulation = get_simulation(model)
    if not keys.file:
        return simulation
    valve = get_model(model)
    names = keys.inputs or valve.inputs
    if len(names) != len(valve.inputs):
        msg = (
            f"{KEY}.inputs = {', '.join(names)}: {model} has {len(valve.inputs)} inputs "
            f"({', '.join(valve.inputs)}); name as many variables, in this order"
        )
        raise ConfigError(msg)
    unit = Unit(keys.file)
    taken = tuple(unit.find("inputs", n, given=True) for n in names)
    output = unit.find("output", keys.output or valve.output, given=False)
    plant = plant_of(unit, valve.inputs, taken, output)
    return replace(simulation, plant=plant, aging=(), scatter=(), fmu=keys)


def plant_of(
    unit: Unit, inputs: tuple[str, ...], taken: tuple[Variable, ...], output: Variable
) -> FmuPlant:
    """Return the plant of an FMU: a frozen dataclass with one quantity a parameter.

    Parameters
    ----------
    unit : Unit
        The FMU.
    inputs : tuple of str
        Names of the M inputs of the valve.
    taken : tuple of Variable
        The M variables that take them.
    output : Variable
        What is measured.
    """
    numbers = [
        (v.name, float, quantity(v.start, v.unit, v.text, ages=v.tunable))
        for v in unit.parameters
        if not hasattr(FmuPlant, v.name) and v.name not in FmuPlant.__annotations__
    ]
    known = {name for name, _, _ in numbers}
    kind = make_dataclass(
        "FmuPlantOfFile",
        numbers,
        bases=(FmuPlant,),
        namespace={
            "inputs": inputs,
            "unit": unit,
            "taken": taken,
            "output": output,
            "parameters": tuple(v for v in unit.parameters if v.name in known),
        },
        frozen=True,
    )
    return cast("FmuPlant", kind())
