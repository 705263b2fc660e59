# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Find valve models by name: those of this package, and those that users add by entry point.

A user's package registers a model without touching this one::

    [project.entry-points."valve_twin.valves"]
    my_valve = "my_package.my_valve:MODEL"
"""

from __future__ import annotations

from difflib import get_close_matches
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.simulation.plant import PlantFactory
    from valve_twin.core.valves.interface import Option, Options, ValveModel

ENTRY_POINT_GROUP = "valve_twin.valves"

_BUILT_IN = (
    "press_cartridge",
    "positioner",
    "stepper_servo",
    "hybrid_actuator",
    "servo_system",
    "double_solenoid",
    "cycle_timing",
    "hydraulic_actuator",
)


def model_names() -> tuple[str, ...]:
    """Return the names of all known models, ours first."""
    added = sorted(
        e.name for e in entry_points(group=ENTRY_POINT_GROUP) if e.name not in _BUILT_IN
    )
    return (*_BUILT_IN, *added)


@cache
def get_model(name: str) -> ValveModel:
    """Return a valve model by its name.

    Raises
    ------
    ValueError
        If there is no such model; the message names the nearest one.
    """
    if name in _BUILT_IN:
        return _checked(import_module(_package(name)).MODEL, name)
    for entry in entry_points(group=ENTRY_POINT_GROUP):
        if entry.name == name:
            return _checked(entry.load(), name)
    near = get_close_matches(name, model_names(), n=1)
    hint = f"did you mean '{near[0]}'?" if near else f"known are {', '.join(model_names())}"
    msg = f"model: '{name}' is unknown; {hint}"
    raise ValueError(msg)


def get_simulation(name: str) -> SimulationConfig:
    """Return the default simulation of a valve by the name of its model.

    Raises
    ------
    ValueError
        If the model is unknown or its package exports no `PLANT`.
    """
    get_model(name)
    plant: PlantFactory | None = getattr(import_module(_package(name)), "PLANT", None)
    if plant is None:
        msg = f"model: '{name}' cannot be simulated: its package exports no PLANT"
        raise ValueError(msg)
    return plant.simulation()


def _package(name: str) -> str:
    """Return the module that exports the model of that name."""
    if name in _BUILT_IN:
        return f"valve_twin.core.valves.{name}"
    return next(e.module for e in entry_points(group=ENTRY_POINT_GROUP) if e.name == name)


def complete_options(model: ValveModel, given: Mapping[str, object]) -> Options:
    """Return the options of a model with defaults filled in; values must have been checked.

    Raises
    ------
    ValueError
        If an option is unknown.
    """
    known = {o.name: o for o in model.options}
    for key in given:
        if key not in known:
            near = get_close_matches(key, known, n=1)
            hint = f"did you mean '{near[0]}'?" if near else f"known are {', '.join(known)}"
            msg = f"options.{key}: unknown to model '{model.name}'; {hint}"
            raise ValueError(msg)
    return {name: given.get(name, _default(o)) for name, o in known.items()}


def _default(option: Option) -> object:
    return list(option.default) if isinstance(option.default, (list, tuple)) else option.default


def _checked(model: object, name: str) -> ValveModel:
    needed = (
        "inputs",
        "output",
        "parameters",
        "options",
        "trend_estimator",
        "estimate",
        "coefficients",
        "predict",
    )
    missing = [a for a in needed if not hasattr(model, a)]
    if missing:
        msg = f"model: '{name}' is no valve model, it lacks {', '.join(missing)}"
        raise ValueError(msg)
    return model  # type: ignore[return-value]
