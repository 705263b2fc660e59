# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A campaign of faults: each fault, each size, many seeds, onset in the middle of an aging record.

All faults of a seed begin from the same state of the same aging valve, whose healthy record goes
on beside them and counts the false alarms.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.detection import detect
from valve_twin.core.diagnosis.isolability import Isolability, isolability
from valve_twin.core.diagnosis.table import BY_NAME, SIZES

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from valve_twin.core.diagnosis.changes.finding import Diagnosis
    from valve_twin.core.diagnosis.config import DetectionConfig
    from valve_twin.core.diagnosis.derive import AgingBench, Bench, V
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.simulation.aging_laws import AgingRule
    from valve_twin.core.types import FloatArray

    Look = Callable[[SignatureTable, DetectionConfig | None, FloatArray], Diagnosis]


@dataclass(frozen=True, slots=True)
class CampaignConfig:
    """What is simulated; fixed before the campaign.

    Attributes
    ----------
    severities : mapping of str to (3,) tuple of float
        Small, medium and large size of each fault [unit of the fault].
    seeds : tuple of int
        One record each.
    cycles : int
        Healthy cycles of a record.
    onset : int
        Cycle of a record that is the first with the fault.
    after : int
        Cycles simulated with the fault.
    aging : tuple of AgingRule
        How the valve ages meanwhile.
    sizes : tuple of str
        Which sizes are run.
    """

    severities: Mapping[str, tuple[float, float, float]]
    seeds: tuple[int, ...] = tuple(range(1, 21))
    cycles: int = 200
    onset: int = 100
    after: int = 10
    aging: tuple[AgingRule, ...] = ()
    sizes: tuple[str, ...] = SIZES


@dataclass(frozen=True, slots=True)
class Case:
    """One record with a fault.

    Attributes
    ----------
    fault, size : str
        Which.
    seed : int
        Of the record.
    severity : float
        Injected [unit of the fault].
    delay : int
        Cycles from the onset to the alarm, the first one with the fault counted; 0 = not detected.
    named : str
        Fault that was named, empty = none.
    estimated : float
        Its size as found [unit of the named fault].
    """

    fault: str
    size: str
    seed: int
    severity: float
    delay: int
    named: str = ""
    estimated: float = float("nan")


@dataclass(frozen=True, slots=True)
class Row:
    """Outcome of one fault of one size over all seeds.

    Attributes
    ----------
    fault, size : str
        Which.
    severity : float
        Size [unit of the fault].
    cases, detected, within_5, named, in_class, part : int
        Records; those detected at all, within 5 cycles; those with the fault named, with one of
        its class named, with the right part named.
    delay_median, delay_most : float
        Cycles to the alarm of those detected; NaN where there is none.
    """

    fault: str
    size: str
    severity: float
    cases: int
    detected: int
    within_5: int
    named: int
    in_class: int
    part: int
    delay_median: float
    delay_most: float


@dataclass(frozen=True, slots=True)
class CampaignResult:
    """What the campaign says; `healthy` cycles raised `alarms` false alarms, listed by seed."""

    cases: tuple[Case, ...]
    healthy: int
    alarms: tuple[tuple[int, str, int], ...]
    isolability: Isolability
    rows: tuple[Row, ...] = field(default=())


def look_at_features(
    table: SignatureTable, config: DetectionConfig | None, rows: FloatArray
) -> Diagnosis:
    """Return what is found in features.

    Parameters
    ----------
    table : SignatureTable
        Signatures.
    config : DetectionConfig or None
        When a change is a fault.
    rows : (N, F or more) array
        Features as they are followed, of the cycles from 1 on [unit by feature]; what a rig
        gives behind them is not looked at.
    """
    features = rows[:, : len(table.features)]
    return detect(np.arange(1, len(rows) + 1), features, table, config)


def run_campaign(
    rig: AgingBench[V],
    table: SignatureTable,
    config: CampaignConfig,
    *,
    detection: DetectionConfig | None = None,
    own: Callable[[V], SignatureTable] | None = None,
    look: Look = look_at_features,
    advance: Callable[[], None] = lambda: None,
) -> CampaignResult:
    """Simulate every record and look at it as the aging monitor does.

    Parameters
    ----------
    rig : AgingBench
        Valve and model.
    table : SignatureTable
        Signatures.
    config : CampaignConfig
        What is simulated.
    detection : DetectionConfig, optional
        When a change is a fault.
    own : callable, optional
        Returns the signatures of a valve before it has a fault; none = `table` for all.
    look : callable
        Returns what is found by signatures in the rows that the rig gives.
    advance : callable
        Called after each seed.

    Returns
    -------
    CampaignResult
        Every case, and the rows of the table.
    """
    aged = rig.aged(config.aging)
    cases: list[Case] = []
    alarms: list[tuple[int, str, int]] = []
    for seed in config.seeds:
        valve = aged.start(seed)
        shapes = own(valve) if own else table
        before = aged.run(valve, config.onset - 1)
        rest = aged.run(deepcopy(valve), config.cycles - config.onset + 1)
        healthy = look(shapes, detection, np.concatenate((before, rest)))
        alarms += [(seed, f.fault, f.alarm) for f in healthy.findings]
        for fault, sizes in config.severities.items():
            for size, severity in zip(SIZES, sizes, strict=True):
                if size in config.sizes:
                    sign = -1.0 if BY_NAME[fault].two_sided and seed % 2 else 1.0
                    case = Case(fault, size, seed, sign * severity, 0)
                    told = partial(look, shapes, detection)
                    cases.append(_run(aged, valve, before, case, config, told))
        advance()
    found = isolability(table, detection)
    result = CampaignResult(tuple(cases), len(config.seeds) * config.cycles, tuple(alarms), found)
    return replace(result, rows=_rows(result))


def _run(
    rig: Bench[V],
    healthy: V,
    before: FloatArray,
    case: Case,
    config: CampaignConfig,
    look: Callable[[FloatArray], Diagnosis],
) -> Case:
    """Run one fault from the state of the healthy valve."""
    valve = deepcopy(healthy)
    valve.set_fault(case.fault, case.severity)
    found = look(np.concatenate((before, rig.run(valve, config.after))))
    later = [f for f in found.findings if f.alarm >= config.onset]
    if not later:
        return case
    first = later[0]
    delay = first.alarm - config.onset + 1
    return replace(case, delay=delay, named=first.fault, estimated=first.severity)


def _rows(result: CampaignResult) -> tuple[Row, ...]:
    """Count the cases by fault and size."""
    keys = dict.fromkeys((c.fault, c.size) for c in result.cases)
    rows = []
    for fault, size in keys:
        cases = [c for c in result.cases if (c.fault, c.size) == (fault, size)]
        delays = np.array([c.delay for c in cases if c.delay > 0], dtype=np.float64)
        together = result.isolability.together(fault)
        parts = {BY_NAME[f].part for f in together}
        rows.append(
            Row(
                fault,
                size,
                abs(cases[0].severity),
                len(cases),
                len(delays),
                int(np.count_nonzero(delays <= 5)),
                sum(c.named == fault for c in cases),
                sum(c.named in together for c in cases),
                sum(c.named in BY_NAME and BY_NAME[c.named].part in parts for c in cases),
                float(np.median(delays)) if len(delays) else float("nan"),
                float(delays.max()) if len(delays) else float("nan"),
            )
        )
    return tuple(rows)
