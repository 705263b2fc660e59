# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which valves can be shown, and how fast: read from `config/` and from the models themselves."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from valve_twin.core.quantity import suggest
from valve_twin.core.types import CycleRule
from valve_twin.core.valves.registry import DEFAULT_MODEL, get_model, model_names
from valve_twin.io.config.valve import load_config
from valve_twin.io.offline.simulated_bag import simulation_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.simulation import SimulationConfig
    from valve_twin.io.config.valve import ValveConfig

ROOT = Path(__file__).resolve().parents[2]
DRIFT = 0.15
"""Relative change that is injected over the demo, in the direction of the file's own law."""

CYCLE_S = 0.6
"""Time that a cycle takes at least [s]: shorter ones run in real time, longer ones faster."""

MESSAGES = 100.0
"""Messages a second and topic above which samples go in batches."""


@dataclass(frozen=True, slots=True)
class Case:
    """One valve that can be shown.

    Attributes
    ----------
    model : str
        Name of the valve's model.
    file : Path
        Its configuration.
    namespace : str
        Where its nodes live, such as "/press/valve_1".
    label : str
        How its files begin.
    aged, followed : str
        Plant parameter that ages, and the published one that shows it.
    aging_rate : float
        Relative change a cycle [1].
    cycles : int
        Cycles to wait for.
    rate : float
        Simulated seconds a second.
    cycle_s : float
        Length of a cycle [s].
    batch : int
        Samples a message.
    counts : bool
        Whether the simulated valve's counter cuts the cycles: windows of fixed length begin
        anywhere in its cycle when it starts now.
    maps_more : bool
        Whether its counter and reference are mapped beside the signals of the file.
    """

    model: str
    file: Path
    namespace: str
    label: str
    aged: str
    followed: str
    aging_rate: float
    cycles: int
    rate: float
    cycle_s: float
    batch: int
    counts: bool = False
    maps_more: bool = False


@cache
def case_names() -> tuple[str, ...]:
    """Return the models that can be shown: simulated ones whose file lets something age."""
    return tuple(name for name in model_names() if _is_shown(name))


def find_case(
    model: str = "", *, file: Path | None = None, cycles: int = 0, rate: float = 0.0
) -> Case:
    """Return how a valve is shown.

    Parameters
    ----------
    model : str
        Name of its model, empty = that of the file, without a file the usual one.
    file : Path, optional
        Its configuration, default the one in `config/` by which the model is shown.
    cycles : int
        Cycles to wait for, 0 = the valve's own number.
    rate : float
        Simulated seconds a second [1], 0 = the valve's own.

    Raises
    ------
    ValueError
        If there is no such valve to show, the file lets none of the model age, or a number is
        outside its range.
    ValveTwinError
        If the file cannot be read.
    """
    model = model or (load_config(file)[0].model if file else DEFAULT_MODEL)
    names = model_names() if file else case_names()
    if model not in names:
        message = f"VALVE = {model}: no such valve to show; {suggest(model, names)}"
        raise ValueError(message)
    if file and not (load_config(file) and model == _aging_model(file)):
        message = f"CONFIG = {file}: lets no valve of the model '{model}' age (simulation.aging)"
        raise ValueError(message)
    if cycles < 0 or not 0.0 <= rate < math.inf:
        message = f"cycles = {cycles}, rate = {rate}: must not be negative"
        raise ValueError(message)
    case = _case(model, file.resolve() if file else shown_file(model), cycles)
    case = replace(case, cycles=cycles or case.cycles, rate=rate or case.rate)
    return replace(case, batch=_batch(case))


def config_of(model: str) -> Path:
    """Return the file in `config/` that lets a simulated valve of a model age.

    That of the model's name goes before others.

    Raises
    ------
    ValueError
        If there is none.
    """
    folder = ROOT / "config"
    own = folder / f"{model}.yaml"
    for file in (own, *sorted(folder.glob("*.yaml"))):
        if file.is_file() and model == _aging_model(file):
            return file
    message = f"no file in {folder} lets a valve of the model '{model}' age"
    raise ValueError(message)


def shown_file(model: str) -> Path:
    """Return the file in `config/` by which a model is shown: the one that it names, else its own.

    Raises
    ------
    ValueError
        If there is none.
    """
    named = get_model(model).demonstration.file
    return ROOT / "config" / named if named else config_of(model)


def injected(case: Case, simulation: SimulationConfig, numbers: Sequence[int]) -> list[float]:
    """Return the truth of the followed parameter in cycles, in any unit: only ratios count.

    Parameters
    ----------
    case : Case
        The valve.
    simulation : SimulationConfig
        Its simulation with the laws of aging.
    numbers : sequence of int
        Numbers of the cycles.
    """
    model = get_model(case.model)
    if model.demonstration.followed:
        return [model.truth(simulation, n)[case.followed] for n in numbers]
    (rule,) = (r for r in simulation.aging if r.parameter == case.aged)
    return [rule.factor(n) for n in numbers]


def _case(model: str, file: Path, cycles: int) -> Case:
    shown = get_model(model).demonstration
    config = load_config(file)[0]
    aged = _aged(config)
    simulation = simulation_of(config)
    (rule,) = (r for r in simulation.aging if r.parameter == aged)
    cycle_s = simulation.program.duration_s
    derived = config.name if config.name.count("/") > 1 else f"/{model}/valve_1"
    drift = math.copysign(DRIFT, rule.rate) / (cycles or shown.cycles)
    counts = config.cycles.rule is CycleRule.WINDOW or shown.counter
    return Case(
        model=model,
        file=file,
        namespace=shown.namespace or derived,
        label=shown.label or model,
        aged=aged,
        followed=shown.followed or _followed(config, aged),
        aging_rate=shown.aging_rate or drift,
        cycles=shown.cycles,
        rate=shown.rate or max(1.0, round(cycle_s / CYCLE_S)),
        cycle_s=cycle_s,
        batch=1,
        counts=counts,
        maps_more=counts or config.cycles.rule is CycleRule.COMMANDS,
    )


def _is_shown(model: str) -> bool:
    try:
        return get_model(model).simulation() is not None and config_of(model).is_file()
    except ValueError:
        return False


@cache
def _aging_model(file: Path) -> str:
    """Return the one model of which a configuration lets a simulated valve age, else nothing."""
    sections = yaml.safe_load(file.read_text(encoding="utf-8")).values()
    trees = [s.get("ros__parameters", {}) for s in sections if isinstance(s, dict)]
    models = {tree["model"] for tree in trees if "model" in tree}
    ages = any(t.get("simulation", {}).get("aging") for t in trees)
    return str(*models) if ages and len(models) == 1 else ""


def _aged(config: ValveConfig) -> str:
    """Return the plant parameter that ages: the first of the file."""
    return next(
        key.removeprefix("aging.").removesuffix(".law")
        for key in _flat(config.simulation)
        if key.startswith("aging.") and key.endswith(".law")
    )


def _flat(tree: Mapping[str, object], prefix: str = "") -> list[str]:
    keys: list[str] = []
    for key, value in tree.items():
        keys += _flat(value, f"{prefix}{key}.") if isinstance(value, dict) else [prefix + key]
    return keys


def _followed(config: ValveConfig, aged: str) -> str:
    """Return the published parameter that shows it: of its name, else the first with a limit."""
    names = {p.name for p in get_model(config.model).parameters if p.trend}
    limits = [t.parameter for t in config.aging.thresholds]
    return aged if aged in names else next((n for n in limits if n in names), aged)


def _batch(case: Case) -> int:
    """Return the samples a message that keep the messages of a topic few."""
    if not get_model(case.model).demonstration.batched:
        return 1
    period_s = load_config(case.file)[0].period_s
    return max(1, round(case.rate / period_s / MESSAGES))
