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
from valve_twin.core.simulation.aging_laws import AgingRule
from valve_twin.core.simulation.faults import Faults
from valve_twin.core.simulation.settings import configure
from valve_twin.core.valves.registry import complete_options, get_model, get_simulation
from valve_twin.io.errors import ConfigError, suggest

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.diagnosis.derive import Diagnosable
    from valve_twin.core.diagnosis.table import SignatureTable

_KEYS = ("model", "seeds", "cycles", "onset", "after", "simulation", "aging", "severities")


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
        given = yaml.safe_load(Path(path).read_text(encoding="utf-8")) or {}
        for key in given:
            if key not in _KEYS:
                msg = f"{path}: unknown key '{key}'; {suggest(str(key), _KEYS)}"
                raise ConfigError(msg)
        model = get_model(given["model"])
        if model.signatures() is None:
            msg = f"{path}: model: '{given['model']}' shows no features of faults"
            raise ConfigError(msg)
        simulation = configure(get_simulation(model.name), given.get("simulation") or {})
        rig = Rig(cast("Diagnosable", model), complete_options(model, {}), simulation)
        config = _config(path, given)
        replace(simulation, aging=config.aging)  # refuses what does not age
        return Campaign(model.name, rig, config)
    except yaml.YAMLError as err:
        msg = f"{path}: not valid YAML: {' '.join(str(err).split())}"
        raise ConfigError(msg) from err
    except (KeyError, TypeError, ValueError, AttributeError) as err:
        what = f"key {err} is missing" if isinstance(err, KeyError) else str(err)
        msg = f"{path}: {what}"
        raise ConfigError(msg) from err


def _config(path: str | Path, given: Mapping[str, Any]) -> CampaignConfig:
    severities = {}
    for name, sizes in (given.get("severities") or {}).items():
        if name not in BY_NAME:
            msg = f"{path}: severities: unknown fault '{name}'; {suggest(name, list(BY_NAME))}"
            raise ConfigError(msg)
        small, medium, large = (float(s) for s in sizes)
        for severity in (small, medium, large):
            Faults().with_fault(name, severity, 0, 0)  # refuses what is out of range
        severities[name] = (small, medium, large)
    cycles, onset = int(given.get("cycles", 200)), int(given.get("onset", 100))
    seeds = int(given.get("seeds", 20))
    if not (seeds > 0 and 25 < onset < cycles):
        msg = (
            f"{path}: seeds = {seeds}, onset = {onset}, cycles = {cycles}: "
            "seeds must be above 0, the onset between cycle 25 and the last"
        )
        raise ConfigError(msg)
    return CampaignConfig(
        severities,
        seeds=tuple(range(1, seeds + 1)),
        cycles=cycles,
        onset=onset,
        after=int(given.get("after", 10)),
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
    target.write_text(head + "\n".join([note, *lines, ""]), encoding="utf-8")
