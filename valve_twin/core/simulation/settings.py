# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Every setting of a simulation by its dotted name: list them, override them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import TYPE_CHECKING, cast

from valve_twin.core.physics.quantity import nearest_hint
from valve_twin.core.simulation.aging_laws import AgingRule
from valve_twin.core.simulation.config import Scatter, SimulationConfig

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


@dataclass(frozen=True, slots=True)
class Setting:
    """One number or word of the tree that can be overridden.

    Attributes
    ----------
    name : str
        Dotted name, e.g. "plant.area_in" or "plant.plc.gain_in".
    value : object
        Its value: float, int, str or a tuple of one of them.
    unit, description : str
        SI unit ("1" = dimensionless) and what it is, with its tag where it is an assumption.
    lower, upper : float
        Allowed range, infinite for words.
    """

    name: str
    value: object
    unit: str
    description: str
    lower: float = -math.inf
    upper: float = math.inf


def list_settings(config: SimulationConfig) -> tuple[Setting, ...]:
    """Return every setting of a simulation with its present value."""
    return tuple(_settings(cast("DataclassInstance", config), ""))


def _settings(node: DataclassInstance, prefix: str) -> Iterator[Setting]:
    for item in fields(node):
        value = getattr(node, item.name)
        if is_dataclass(value) and not isinstance(value, type):
            yield from _settings(value, f"{prefix}{item.name}.")
        elif "unit" in item.metadata:
            meta = item.metadata
            lower, upper = meta.get("lower", -math.inf), meta.get("upper", math.inf)
            name = f"{prefix}{item.name}"
            yield Setting(name, value, meta["unit"], meta["description"], lower, upper)


def configure(config: SimulationConfig, given: Mapping[str, object]) -> SimulationConfig:
    """Return a simulation with some settings replaced.

    Parameters
    ----------
    config : SimulationConfig
        Where to start from, e.g. the default of a valve.
    given : mapping
        Values by dotted name or nested, as in `list_settings`; besides these
        "aging.<parameter>.law", ".rate" and ".start_cycle" add or change a rule, and
        "scatter.<parameter>" a scatter.

    Raises
    ------
    ValueError
        If a name is unknown (the nearest one is named), a type is wrong or a value outside its
        range.
    """
    flat = dict(_flatten(given, ""))
    known = {s.name: s for s in list_settings(config)}
    rules = {k: flat.pop(k) for k in list(flat) if k.startswith("aging.")}
    scatter = {k: flat.pop(k) for k in list(flat) if k.startswith("scatter.")}
    for name in flat:
        if name not in known:
            message = f"simulation.{name}: unknown setting{nearest_hint(name, known)}"
            raise ValueError(message)
    values = {name: _convert(known[name], value) for name, value in flat.items()}
    values["aging"] = _aging_rules(config, rules)
    values["scatter"] = _scatters(config, scatter)
    return cast("SimulationConfig", _replaced(cast("DataclassInstance", config), values, ""))


def _flatten(given: Mapping[str, object], prefix: str) -> Iterator[tuple[str, object]]:
    for key, value in given.items():
        if isinstance(value, Mapping):
            yield from _flatten(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _convert(setting: Setting, value: object) -> object:
    """Return a value in the type of the setting; an integer may stand for a float."""
    present = setting.value
    where = f"simulation.{setting.name} = {value!r}"
    if isinstance(present, tuple):
        if isinstance(value, str) or not hasattr(value, "__iter__"):
            message = f"{where}: must be a list"
            raise ValueError(message)
        words = bool(present) and isinstance(present[0], str)
        return tuple(str(v) if words else _number(where, v) for v in value)
    if isinstance(present, str):
        if not isinstance(value, str):
            message = f"{where}: must be a word"
            raise ValueError(message)
        return value
    number = _number(where, value, setting)
    if isinstance(present, int):
        if number != int(number):
            message = f"{where}: must be a whole number"
            raise ValueError(message)
        return int(number)
    return number


def _number(where: str, value: object, setting: Setting | None = None) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        allowed = ""
        if setting is not None and math.isfinite(setting.lower + setting.upper):
            allowed = f" from {setting.lower:g} to {setting.upper:g} [{setting.unit}]"
        message = f"{where}: must be a finite number{allowed}"
        raise ValueError(message)
    return float(value)


def _aging_rules(config: SimulationConfig, given: Mapping[str, object]) -> tuple[AgingRule, ...]:
    rules = {rule.parameter: rule for rule in config.aging}
    for name, value in given.items():
        parts = name.split(".")
        if len(parts) != 3 or parts[2] not in {"law", "rate", "start_cycle"}:
            message = (
                f"simulation.{name}: unknown setting; "
                "known are aging.<parameter>.law, .rate and .start_cycle"
            )
            raise ValueError(message)
        rule = rules.get(parts[1], AgingRule(parts[1], "linear", 0.0, config.first_cycle))
        present: object = getattr(rule, parts[2])
        setting = Setting(name, present, "1", "")
        rules[parts[1]] = replace(rule, **{parts[2]: _convert(setting, value)})  # type: ignore[arg-type]
    return tuple(rules.values())


def _scatters(config: SimulationConfig, given: Mapping[str, object]) -> tuple[Scatter, ...]:
    scatters = {s.parameter: s for s in config.scatter}
    for name, value in given.items():
        parameter = name.removeprefix("scatter.")
        scatters[parameter] = Scatter(parameter, _number(f"simulation.{name} = {value!r}", value))
    return tuple(scatters.values())


def _replaced(
    node: DataclassInstance, values: Mapping[str, object], prefix: str
) -> DataclassInstance:
    """Return a copy of a branch of the tree with the values below `prefix` replaced."""
    changes: dict[str, object] = {}
    for item in fields(node):
        name = f"{prefix}{item.name}"
        value = getattr(node, item.name)
        if is_dataclass(value) and not isinstance(value, type):
            changes[item.name] = _replaced(value, values, f"{name}.")
        elif name in values:
            changes[item.name] = values[name]
    return replace(node, **changes)
