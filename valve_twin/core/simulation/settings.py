# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Override every setting of a simulation by its dotted name."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import cast

from valve_twin.core.quantity import Descriptor, Kind, checked, describe, replaced
from valve_twin.core.simulation.aging_laws import AgingRule
from valve_twin.core.simulation.config import Scatter, SimulationConfig


def configure(config: SimulationConfig, given: Mapping[str, object]) -> SimulationConfig:
    """Return a simulation with some settings replaced.

    Parameters
    ----------
    config : SimulationConfig
        Where to start from, e.g. the default of a valve.
    given : mapping
        Values by dotted name or nested, as `describe` lists them; besides these
        "aging.<parameter>.law", ".rate" and ".start_cycle" add or change a rule, and
        "scatter.<parameter>" a scatter.

    Raises
    ------
    ValueError
        If a name is unknown (the nearest one is named), a type is wrong or a value outside its
        range.
    """
    flat = dict(_flatten(given, ""))
    rules = {k: flat.pop(k) for k in list(flat) if k.startswith("aging.")}
    scatter = {k: flat.pop(k) for k in list(flat) if k.startswith("scatter.")}
    values = checked(config, flat, where="simulation.")
    changed = replaced(config, values)
    return replace(changed, aging=_aging_rules(config, rules), scatter=_scatters(config, scatter))


def _flatten(given: Mapping[str, object], prefix: str) -> Iterator[tuple[str, object]]:
    for key, value in given.items():
        if isinstance(value, Mapping):
            yield from _flatten(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _checked(known: Descriptor, value: object) -> object:
    """Return a value in the type of the setting; an integer may stand for a float."""
    try:
        checked = known.check(value)
    except ValueError as err:
        message = f"simulation.{known.name}: {err}"
        raise ValueError(message) from None
    if isinstance(checked, float) and not math.isfinite(checked):
        message = f"simulation.{known.name}: value {value!r} is not a finite number"
        raise ValueError(message)
    return checked


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
        known = next(d for d in describe(rule, f"aging.{parts[1]}.") if d.name == name)
        rules[parts[1]] = replace(rule, **{parts[2]: _checked(known, value)})  # type: ignore[arg-type]
    return tuple(rules.values())


def _scatters(config: SimulationConfig, given: Mapping[str, object]) -> tuple[Scatter, ...]:
    scatters = {s.parameter: s for s in config.scatter}
    for name, value in given.items():
        parameter = name.removeprefix("scatter.")
        sigma = _checked(Descriptor(name, Kind.FLOAT, 0.0), value)
        scatters[parameter] = Scatter(parameter, cast("float", sigma))
    return tuple(scatters.values())
