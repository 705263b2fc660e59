# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Record a simulated valve straight into a bag, without ROS, as fast as it can be computed."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
import yaml

from valve_twin.core.simulation import SimulatedValve
from valve_twin.io.bags.read import BagWriter
from valve_twin.io.cdr.signals import SERIES_TYPE
from valve_twin.io.errors import ConfigError
from valve_twin.io.fmu.plant import simulation_for
from valve_twin.io.limits import load_yaml

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from valve_twin.core.simulation import SimulationBlock, SimulationConfig
    from valve_twin.core.types import FloatArray, IntArray
    from valve_twin.io.config.valve import ValveConfig

_EXPONENT = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+")

SERIES_SAMPLES = 100
"""Samples in one message of a signal that is configured as Float64Series."""

START_NS = 1_600_000_000_000_000_000
"""Stamp of the first sample [ns]: a fixed date, because stamp 0 means "no stamp" in ROS."""


def simulation_of(config: ValveConfig, overrides: Sequence[str] = ()) -> SimulationConfig:
    """Return the simulation of a configured valve.

    Parameters
    ----------
    config : ValveConfig
        Its `simulation` section and its sampling time.
    overrides : sequence of str
        More settings as NAME=VALUE, VALUE as in YAML.

    Raises
    ------
    ConfigError
        If a setting is unknown, of a wrong type or outside its range.
    """
    given: dict[str, object] = {"period_s": config.period_s, **config.simulation}
    for text in overrides:
        name, equals, value = text.partition("=")
        if not equals:
            msg = f"--set {text}: write NAME=VALUE, e.g. aging.area_in.rate=-0.0015"
            raise ConfigError(msg)
        given[name.removeprefix("simulation.")] = _value(text, value)
    given.pop("seed", None)
    try:
        return simulation_for(config.model, given)
    except ValueError as err:
        msg = f"{config.name}: {err}"
        raise ConfigError(msg) from err


def _value(setting: str, text: str) -> object:
    """Read a value as a parameter file does, where 1e-3 is a number."""
    try:
        return float(text) if _EXPONENT.fullmatch(text) else load_yaml(text)
    except yaml.YAMLError as err:
        msg = f"--set {setting}: '{text}' is no value of YAML; write a number, a word or [a, b]"
        raise ConfigError(msg) from err


def write_simulated_bag(
    config: ValveConfig,
    path: str | Path,
    *,
    cycles: int,
    seed: int = 0,
    overrides: Sequence[str] = (),
    on_cycle: Callable[[], None] = lambda: None,
) -> int:
    """Simulate production cycles and write what the valve shows.

    Parameters
    ----------
    config : ValveConfig
        The valve; its signals say which topics are written.
    path : path
        Bag folder to make.
    cycles : int
        Production cycles, 1 or more.
    seed : int
        Seed of all random numbers.
    overrides : sequence of str
        Settings as NAME=VALUE on top of the configuration.
    on_cycle : callable
        Called after each cycle.

    Returns
    -------
    int
        Messages written.

    Raises
    ------
    ConfigError
        If a setting cannot be used, or with it the integration fails; what came before is kept.
    BagError
        If the bag cannot be written.
    """
    simulation = simulation_of(config, overrides)
    valve = SimulatedValve(simulation, seed)
    written = 0
    with BagWriter(path) as bag:
        bag.note({"valve": config.name, "model": config.model, "seed": seed, "simulated": True})
        for _ in range(cycles):
            block = valve.advance(simulation.cycle_samples)
            if valve.failure:
                msg = f"{config.name}: cycle {valve.cycle}: {valve.failure}"
                raise ConfigError(msg)
            written += _write_block(bag, config, valve.plant.inputs, block)
            on_cycle()
    return written


def _write_block(
    bag: BagWriter, config: ValveConfig, inputs: tuple[str, ...], block: SimulationBlock
) -> int:
    topics = {name: source.topic for name, source in config.signals.items()}
    position = next(n for n in topics if n not in {*inputs, "cycle_counter", "reference"})
    columns = {name: block.inputs[:, j] for j, name in enumerate(inputs)}
    columns["cycle_counter"] = block.cycle.astype(float)
    columns["reference"] = block.reference
    stamps = block.stamp_ns + START_NS
    rows = [(topics[n], stamps, values) for n, values in columns.items() if n in topics]
    delivered = block.delivered
    series = {source.topic for source in config.signals.values() if source.type == SERIES_TYPE}
    if topics[position] in series:
        rows.append((topics[position], stamps, np.where(delivered, block.position, np.nan)))
    else:
        rows.append((topics[position], stamps[delivered], block.position[delivered]))
    singles = [row for row in rows if row[0] not in series]
    if singles:
        bag.write_samples(singles)
    batches = _write_series(bag, config.period_s, [row for row in rows if row[0] in series])
    return sum(len(stamps) for _, stamps, _ in singles) + batches


def _write_series(
    bag: BagWriter, period_s: float, rows: Sequence[tuple[str, IntArray, FloatArray]]
) -> int:
    """Write what is configured as Float64Series in batches; a lost sample has no value there."""
    written = 0
    for at in range(0, len(rows[0][1]) if rows else 0, SERIES_SAMPLES):
        part = slice(at, at + SERIES_SAMPLES)
        for topic, stamps, values in rows:
            bag.write_series(topic, int(stamps[at]), period_s, values[part])
            written += 1
    return written
