# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which valves can be shown, and how fast: read from `config/` and from the models themselves."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from valve_twin.core.simulation import cycle_truth
from valve_twin.core.types import CycleRule
from valve_twin.core.valves.registry import get_model, get_simulation, model_names
from valve_twin.io.config.valve import load_config
from valve_twin.io.offline.simulated_bag import simulation_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.simulation import SimulationConfig
    from valve_twin.io.config.valve import ValveConfig

ROOT = Path(__file__).resolve().parents[2]
DEFAULT = "press_cartridge"
FILES = {DEFAULT: "simulated_press.yaml"}
"""Files in `config/` that do not bear the name of their model."""

DRIFT = 0.15
"""Relative change that is injected over the demo, in the direction of the file's own law."""

PACES = {"servo_system": (24, 2.0)}
"""Cycles and rate of valves whose estimation takes longer than a cycle would: 1.2 s of a core."""

CYCLES = 60
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


def case_names() -> tuple[str, ...]:
    """Return the models that can be shown: simulated ones whose file lets something age."""
    return tuple(name for name in model_names() if _is_shown(name))


def find_case(model: str, *, cycles: int = 0, rate: float = 0.0) -> Case:
    """Return how a valve is shown.

    Parameters
    ----------
    model : str
        Name of its model.
    cycles : int
        Cycles to wait for, 0 = the valve's own number.
    rate : float
        Simulated seconds a second [1], 0 = the valve's own.

    Raises
    ------
    ValueError
        If there is no such valve to show, or a number is outside its range.
    """
    names = case_names()
    if model not in names:
        near = get_close_matches(model, names, n=1)
        hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(names)}"
        message = f"VALVE = {model}: no such valve to show; {hint}"
        raise ValueError(message)
    if cycles < 0 or not 0.0 <= rate < math.inf:
        message = f"cycles = {cycles}, rate = {rate}: must not be negative"
        raise ValueError(message)
    case = _press() if model == DEFAULT else _derived(model, cycles)
    case = replace(case, cycles=cycles or case.cycles, rate=rate or case.rate)
    return replace(case, batch=_batch(case))


def config_of(model: str) -> Path:
    """Return the configuration file of a model."""
    return ROOT / "config" / FILES.get(model, f"{model}.yaml")


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
    if case.model == DEFAULT:  # a steady gain is no number of the plant
        return [float(cycle_truth(simulation, n).gains[0]) for n in numbers]
    (rule,) = (r for r in simulation.aging if r.parameter == case.aged)
    return [rule.factor(n) for n in numbers]


def _press() -> Case:
    """Return the press valve: -14 % of the filling pilot area over 70 cycles."""
    return Case(
        model=DEFAULT,
        file=config_of(DEFAULT),
        namespace="/press/valve_1",
        label="press",
        aged="area_in",
        followed="K_in",
        aging_rate=-0.002,
        cycles=70,
        rate=20.0,
        cycle_s=25.5,
        batch=1,
    )


def _derived(model: str, cycles: int) -> Case:
    file = config_of(model)
    config = load_config(file)[0]
    aged = _aged(config)
    simulation = simulation_of(config)
    (rule,) = (r for r in simulation.aging if r.parameter == aged)
    cycle_s = simulation.program.duration_s
    own_cycles, rate = PACES.get(model, (CYCLES, max(1.0, round(cycle_s / CYCLE_S))))
    return Case(
        model=model,
        file=file,
        namespace=config.name if config.name.count("/") > 1 else f"/{model}/valve_1",
        label=model,
        aged=aged,
        followed=_followed(config, aged),
        aging_rate=math.copysign(DRIFT, rule.rate) / (cycles or own_cycles),
        cycles=own_cycles,
        rate=rate,
        cycle_s=cycle_s,
        batch=1,
        counts=config.cycles.rule is CycleRule.WINDOW or model in PACES,
    )


def _is_shown(model: str) -> bool:
    file = config_of(model)
    if not file.is_file():
        return False
    try:
        get_simulation(model)
    except ValueError:
        return False
    sections = yaml.safe_load(file.read_text(encoding="utf-8")).values()
    return any(s["ros__parameters"].get("simulation", {}).get("aging") for s in sections)


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
    if case.model == DEFAULT:
        return 1
    period_s = load_config(case.file)[0].period_s
    return max(1, round(case.rate / period_s / MESSAGES))
