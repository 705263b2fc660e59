# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The file that fixes a campaign of faults before it is run."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import yaml

from valve_twin.core.diagnosis.campaign import CampaignConfig
from valve_twin.core.diagnosis.derive import Rig
from valve_twin.core.diagnosis.table import BY_NAME, SIZES
from valve_twin.core.quantity import describe, quantity, replaced, setting, suggest
from valve_twin.core.simulation.aging_laws import AgingRule
from valve_twin.core.simulation.faults import Faults
from valve_twin.core.valves.registry import complete_options, get_model
from valve_twin.io.errors import ConfigError
from valve_twin.io.fmu.plant import simulation_for
from valve_twin.io.limits import load_yaml
from valve_twin.io.whole import write_whole

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.diagnosis.derive import Diagnosable
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.valves.interface import ValveModel

_SECTIONS = ("simulation", "aging", "severities")


@dataclass(frozen=True, slots=True)
class CampaignKeys:
    """Keys of the file beside its sections."""

    model: str = setting("", "Valve and model; to be written.")
    seeds: int = quantity(20, "1", "Records.", lower=1)
    cycles: int = quantity(200, "1", "Healthy cycles of a record.", lower=27)
    onset: int = quantity(100, "1", "First cycle with the fault.", lower=26)
    after: int = quantity(10, "1", "Cycles simulated with the fault.", lower=1)


@dataclass(frozen=True, slots=True)
class Campaign:
    """A campaign as configured: the model's name, valve and model, what is simulated."""

    model: str
    rig: Rig
    config: CampaignConfig


def load_campaign(path: str | Path) -> Campaign:
    """Read the file of a campaign.

    Parameters
    ----------
    path : path
        YAML with the keys model, seeds, cycles, onset, after, simulation, aging, severities.

    Returns
    -------
    Campaign
        What is to be simulated.

    Raises
    ------
    ConfigError
        If a key is unknown or a value cannot be used.
    """
    try:
        given = load_yaml(Path(path).read_text(encoding="utf-8")) or {}
        keys = _keys(given)
        model = _model(keys.model)
        if model.signatures() is None:
            msg = f"{path}: key 'model': '{model.name}' shows no features of faults"
            raise ConfigError(msg)
        simulation = simulation_for(model.name, given.get("simulation") or {})
        rig = Rig(cast("Diagnosable", model), complete_options(model, {}), simulation)
        config = _config(given, keys)
        replace(simulation, aging=config.aging)  # refuses what does not age
        return Campaign(model.name, rig, config)
    except yaml.YAMLError as err:
        msg = f"{path}: not valid YAML: {' '.join(str(err).split())}"
        raise ConfigError(msg) from err
    except (TypeError, ValueError, AttributeError) as err:
        msg = f"{path}: {err}"
        raise ConfigError(msg) from err


def _model(name: str) -> ValveModel:
    try:
        return get_model(name)
    except ValueError as err:
        msg = f"key 'model': {err}"
        raise ValueError(msg) from None


def _keys(given: Mapping[str, Any]) -> CampaignKeys:
    """Check and return the keys of the file."""
    known = {d.name: d for d in describe(CampaignKeys)}
    values = {}
    for key, value in given.items():
        if key not in known and key not in _SECTIONS:
            msg = f"unknown key '{key}'; {suggest(str(key), (*known, *_SECTIONS))}"
            raise ValueError(msg)
        try:
            values[key] = known[key].check(value) if key in known else value
        except ValueError as err:
            msg = f"key '{key}': {err}"
            raise ValueError(msg) from None
    keys = replaced(CampaignKeys(), values)
    if keys.onset >= keys.cycles:
        msg = f"key 'onset': value {keys.onset} is not below cycles = {keys.cycles}; lower it"
        raise ValueError(msg)
    return keys


def _config(given: Mapping[str, Any], keys: CampaignKeys) -> CampaignConfig:
    severities = {}
    for name, sizes in (given.get("severities") or {}).items():
        if name not in BY_NAME:
            msg = f"severities: unknown fault '{name}'; {suggest(name, list(BY_NAME))}"
            raise ValueError(msg)
        small, medium, large = (float(s) for s in sizes)
        for severity in (small, medium, large):
            Faults().with_fault(name, severity, 0, 0)  # refuses what is out of range
        severities[name] = (small, medium, large)
    return CampaignConfig(
        severities,
        seeds=tuple(range(1, keys.seeds + 1)),
        cycles=keys.cycles,
        onset=keys.onset,
        after=keys.after,
        aging=tuple(
            AgingRule(name, "linear", float(rate))
            for name, rate in (given.get("aging") or {}).items()
        ),
    )


def write_severities(path: str | Path, table: SignatureTable) -> None:
    """Write the sizes of a table into the file of a campaign; all else stays as it is."""
    lines = []
    for name in table.faults:
        sizes = [s.severity for s in table.signatures if s.fault == name][: len(SIZES)]
        unit = BY_NAME[name].unit
        text = ", ".join(f"{s:.3g}" for s in sizes)
        lines.append(f"  {name}: [{text}]".ljust(52) + f"# {BY_NAME[name].text} [{unit}]")
    target = Path(path)
    text = target.read_text(encoding="utf-8")
    head = re.split(r"^severities:.*$", text, maxsplit=1, flags=re.MULTILINE)[0]
    note = "severities:".ljust(52) + "# small, medium, large; written by --derive"
    write_whole(target, head + "\n".join([note, *lines, ""]))
