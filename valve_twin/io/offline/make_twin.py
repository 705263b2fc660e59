# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Make the twin of a configured valve, for the live node and for the offline command alike."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.core.alignment import SignalRange
from valve_twin.core.twin import Twin, TwinConfig
from valve_twin.core.types import CONDITIONS, CycleRule
from valve_twin.core.valves.registry import get_model
from valve_twin.io.errors import ConfigError

if TYPE_CHECKING:
    from valve_twin.core.estimation.cycle.memory import Memory
    from valve_twin.core.state import Resume
    from valve_twin.core.valves.interface import ValveModel
    from valve_twin.io.config.valve import ValveConfig

_NEEDED = {CycleRule.COUNTER: "cycle_counter", CycleRule.REFERENCE: "reference"}


def twin_config(config: ValveConfig, model: ValveModel) -> TwinConfig:
    """Translate a valve's configuration for the core.

    Parameters
    ----------
    config : ValveConfig
        The configuration, checked.
    model : ValveModel
        The model it names.

    Returns
    -------
    TwinConfig
        Signals in the model's order, ranges, cycle rule and complete options.

    Raises
    ------
    ConfigError
        If a signal is missing that the model or the cycle rule needs.
    """
    required = [model.output, *model.inputs]
    needed = _NEEDED.get(config.cycles.rule)
    if needed is not None:
        required.append(needed)
    for name in required:
        if name not in config.signals:
            msg = (
                f"{config.name}: signals.{name}: not mapped, but the model '{model.name}' with "
                f"cycles.rule '{config.cycles.rule.value}' needs it; give its topic"
            )
            raise ConfigError(msg)
    ranges = {k: SignalRange(k, s.lower, s.upper) for k, s in config.signals.items()}
    return TwinConfig(
        period_s=config.period_s,
        signals=tuple(ranges[k] for k in (model.output, *model.inputs)),
        counter=ranges.get("cycle_counter"),
        reference=ranges.get("reference"),
        cycles=config.cycles,
        options=config.options,
        hold_back_s=config.hold_back_s,
        conditions=tuple(ranges[k] for k in CONDITIONS if k in ranges),
    )


def make_twin(
    config: ValveConfig,
    *,
    memory: Memory | None = None,
    last_cycle: int = 0,
    resume: Resume | None = None,
) -> Twin:
    """Return the twin of a configured valve.

    Parameters
    ----------
    config : ValveConfig
        The configuration, checked.
    memory : Memory, optional
        What the stored cycles taught.
    last_cycle : int
        Number of the last stored cycle, 0 = none.
    resume : Resume, optional
        What is known of it and of the cycles announced since.

    Raises
    ------
    ConfigError
        If a signal is missing, or the cycle rule names a command that the model does not have.
    """
    model = get_model(config.model)
    core = twin_config(config, model)
    try:
        return Twin(core, model, memory=memory, last_cycle=last_cycle, resume=resume)
    except ValueError as err:
        msg = f"{config.name}: {err}"
        raise ConfigError(msg) from err
