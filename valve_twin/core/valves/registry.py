# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Find valve models by name: every entry point of the group `valve_twin.valves`.

A user's package registers a model without touching this one::

    [project.entry-points."valve_twin.valves"]
    my_valve = "my_package.my_valve:VALVE"
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import EntryPoint, PackageNotFoundError, distribution, entry_points
from typing import TYPE_CHECKING, TypeVar, cast

from valve_twin.core.quantity import checked, replaced, suggest
from valve_twin.core.valves.interface import ModelOptions, ValveModel

if TYPE_CHECKING:
    from collections.abc import Mapping

    from _typeshed import DataclassInstance

    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.valves.interface import HasOptions

Given = TypeVar("Given")

ENTRY_POINT_GROUP = "valve_twin.valves"

DEFAULT_MODEL = "press_cartridge"
"""Model of a configuration that names none: configurations from before there were others."""

MEMBERS = tuple(m for m in (*ValveModel.__annotations__, *vars(ValveModel)) if m[0] != "_")
"""Every member of the protocol."""


def model_names() -> tuple[str, ...]:
    """Return the names of all known models in alphabetical order, those of this package first."""
    ours = _ours()
    added = {e.name for e in entry_points(group=ENTRY_POINT_GROUP)} - ours.keys()
    return (*sorted(ours), *sorted(added))


@cache
def get_model(name: str) -> ValveModel:
    """Return a valve model by its name.

    Raises
    ------
    ValueError
        If there is no such model, the message names the nearest one; if what is registered cannot
        be loaded; or if it lacks a member of `ValveModel`, has options of another kind or is
        driven by what is no input.
    """
    entry = _entry(name)
    if entry is not None:
        try:
            model = entry.load()
        except Exception as err:  # a package of somebody else's
            why = " ".join(f"{type(err).__name__}: {err}".split())
            msg = f"'{name}' is registered as '{entry.value}', which cannot be loaded: {why}"
            raise ValueError(msg) from err
        return _checked(model, name)
    names = model_names()
    none = f"; no package registers any in '{ENTRY_POINT_GROUP}': install anew (make setup)"
    msg = f"'{name}' is unknown; {suggest(name, names) if names else none}"
    raise ValueError(msg)


def model_module(name: str) -> str:
    """Return the name of the module that a model is loaded from, empty where there is none."""
    entry = _entry(name)
    return entry.module if entry is not None else ""


def get_simulation(name: str) -> SimulationConfig:
    """Return the default simulation of a valve by the name of its model.

    Raises
    ------
    ValueError
        If the model is unknown or has no simulation.
    """
    simulation = get_model(name).simulation()
    if simulation is None:
        msg = f"model '{name}' cannot be simulated: its simulation() returns None"
        raise ValueError(msg)
    return simulation


def _entry(name: str) -> EntryPoint | None:
    entry = _ours().get(name)
    if entry is None:  # a look at every installed distribution takes a while
        entry = next((e for e in entry_points(group=ENTRY_POINT_GROUP) if e.name == name), None)
    return entry


@cache
def _ours() -> dict[str, EntryPoint]:
    """Return the entry points of this package by name."""
    try:
        found = distribution("valve_twin").entry_points
    except PackageNotFoundError:
        return {}
    return {e.name: e for e in found if e.group == ENTRY_POINT_GROUP}


def complete_options(model: HasOptions[Given], given: Mapping[str, object]) -> Given:
    """Return the options of a model with defaults filled in.

    Raises
    ------
    ValueError
        If an option is unknown, of the wrong type or outside its limits.
    """
    options = cast("DataclassInstance", model.options)
    values = checked(options, given, where="options.", unknown=f"unknown to model '{model.name}'")
    return replaced(model.options, values)


def _checked(model: object, name: str) -> ValveModel:
    # properties are not asked for their values: some of those take imports of half a second
    missing = [m for m in MEMBERS if not (hasattr(type(model), m) or hasattr(model, m))]
    if missing:
        msg = (
            f"'{name}' is no valve model, it lacks {', '.join(missing)}; "
            "inherit from valve_twin.core.valves.interface.ValveModel"
        )
        raise ValueError(msg)
    whole = cast("ValveModel", model)
    if not isinstance(whole.options, ModelOptions):
        msg = (
            f"'{name}' is no valve model: its options are a {type(whole.options).__name__}, which "
            "does not inherit from valve_twin.core.valves.interface.ModelOptions"
        )
        raise ValueError(msg)
    unknown = [n for n in whole.driven_by or () if n not in whole.inputs]
    if unknown:
        msg = (
            f"'{name}' is no valve model: driven_by names {', '.join(unknown)}, its inputs are "
            f"{', '.join(whole.inputs)}"
        )
        raise ValueError(msg)
    return whole
