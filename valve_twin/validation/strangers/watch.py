# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Show a stranger to the twin and its aging monitor as a user would, and keep what they say.

Cycles go through the same machine as a bag, sample by sample; after each estimate the monitor
assesses the whole history so far.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.assess import assess
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.twin import Estimated, Twin
from valve_twin.core.valves.registry import get_model
from valve_twin.validation.strangers.record import record

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from valve_twin.core.aging.assess import Assessment
    from valve_twin.core.aging.config import AgingConfig
    from valve_twin.core.twin import TwinConfig
    from valve_twin.core.types import Estimate
    from valve_twin.validation.strangers.draw import Stranger
    from valve_twin.validation.strangers.kernel import Press

MODEL = "press_cartridge"
AS_SHIPPED: dict[str, object] = {
    "model": MODEL,
    "signals.v_in.lower": -0.05,
    "signals.v_in.upper": 1.05,
    "signals.v_out.lower": -0.05,
    "signals.v_out.upper": 1.05,
    "signals.spool_position.lower": -0.1,
    "signals.spool_position.upper": 1.1,
    "cycles.start_signal": "v_in",
    "cycles.rearm_signal": "v_out",
    "options.estimators": ["output_error", "kalman", "equation_error_qp4", "features"],
    "aging.thresholds.K_in.value": -15.0,
}
"""What differs from the defaults in config/press_cartridge.yaml."""

LIFE_CONFIDENCE = 0.90
"""Of the limits of the remaining life that are scored."""


@dataclass(frozen=True, slots=True)
class Setup:
    """How the twin is configured that meets the strangers: as shipped."""

    twin: TwinConfig
    aging: AgingConfig


@dataclass(frozen=True, slots=True)
class Said:
    """What is said of one production cycle.

    Attributes
    ----------
    cycle : int
        Production cycle, counted from 1.
    present : Press
        The press as it was then.
    estimates : tuple of Estimate
        Of every estimator; empty where the cycle gave none.
    assessment : Assessment or None
        Trends and verdict after this cycle; None before the first.
    """

    cycle: int
    present: Press
    estimates: tuple[Estimate, ...]
    assessment: Assessment | None


def watch(stranger: Stranger, setup: Setup) -> list[Said]:
    """Estimate and assess every cycle of a stranger.

    Parameters
    ----------
    stranger : Stranger
        Which.
    setup : Setup
        The twin's configuration; its sampling time is set to the stranger's.

    Returns
    -------
    list of Said
        One a production cycle, in order.
    """
    presses: list[Press] = []
    found = _estimated(stranger, setup, presses)
    return list(_assessed(found, presses, setup))


def estimated(stranger: Stranger, setup: Setup) -> list[tuple[Estimate, ...]]:
    """Estimate every cycle of a stranger.

    Parameters
    ----------
    stranger : Stranger
        Which.
    setup : Setup
        The twin's configuration; its sampling time is set to the stranger's.

    Returns
    -------
    list of tuple of Estimate
        Those of every estimator, by production cycle; empty where it gave none.
    """
    found = _estimated(stranger, setup, [])
    return [found.get(number, ()) for number in range(1, stranger.cycles + 1)]


def _estimated(
    stranger: Stranger, setup: Setup, presses: list[Press]
) -> dict[int, tuple[Estimate, ...]]:
    """Return the estimates by production cycle, and add the press of each to `presses`."""
    model = get_model(MODEL)
    twin = Twin(replace(setup.twin, period_s=stranger.logger.period_s), model)
    twin.predicts = False
    starts: list[int] = []
    found: dict[int, tuple[Estimate, ...]] = {}
    for part in record(stranger):
        starts.append(part.start_ns)
        presses.append(part.present)
        events = twin.push_round(
            (
                (model.inputs[0], part.command_ns, part.commands[:, 0]),
                (model.inputs[1], part.command_ns, part.commands[:, 1]),
                (model.output, part.stamp_ns, part.position),
            )
        )
        _settle(twin, events, setup, starts, found)
    _settle(twin, twin.finish(), setup, starts, found)
    return found


def _settle(
    twin: Twin,
    events: Sequence[object],
    setup: Setup,
    starts: list[int],
    found: dict[int, tuple[Estimate, ...]],
) -> None:
    """Run the estimations that are due and file them under their production cycle."""
    model = get_model(MODEL)
    waiting = list(events)
    while True:
        for event in waiting:
            if isinstance(event, Estimated):
                ends = (event.cycle.start_ns, event.cycle.end_ns)
                first, last = np.searchsorted(starts, ends, side="right").tolist()
                number = max(first, last - 1)  # the next one has begun when a cycle is over
                found[number] = found.get(number, ()) + event.estimates
        job = twin.next_job()
        if job is None:
            return
        estimates, memory = estimate_cycle(model, setup.twin.options, job.cycle, job.memory)
        waiting = list(twin.deliver(estimates, memory))


def _assessed(
    found: dict[int, tuple[Estimate, ...]], presses: list[Press], setup: Setup
) -> Iterator[Said]:
    history: list[Estimate] = []
    last: Assessment | None = None
    for number, press in enumerate(presses, 1):
        estimates = found.get(number, ())
        history += estimates
        if estimates:
            last = assess(
                history,
                (),
                setup.aging,
                parameters=get_model(MODEL).parameters,
                valve="stranger",
                confidence=LIFE_CONFIDENCE,
            )
        yield Said(number, press, estimates, last)
