# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Hold what was told of strangers against what was wrong with them.

Every figure is a share, hits of cases. A trouble counts where it begins when a fault can be told:
behind the cycles of the reference model and those of the first line; one that begins earlier is
counted apart. What is told of the cycle in which it begins finds it, even where less than half of
that cycle has it. Whatever is told of cycles without a trouble is a false alarm.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.core.diagnosis.config import DetectionConfig
from valve_twin.core.diagnosis.generic.reference import REFERENCE_CYCLES
from valve_twin.validation.any_strangers.watch import first_with, touched_by
from valve_twin.validation.strangers.score import Score

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.changes.finding import Finding
    from valve_twin.validation.any_strangers.draw import Stranger
    from valve_twin.validation.any_strangers.watch import Told

JUDGED_FROM = REFERENCE_CYCLES + DetectionConfig().least + 1
"""First of the twin's cycles in which a trouble may begin that must be found."""

WITHIN = 5
"""Cycles within which a trouble must be found, that of its onset counted."""


def score(stranger: Stranger, told: list[Told]) -> Score:
    """Score all that was told of a stranger.

    Parameters
    ----------
    stranger : Stranger
        The truth.
    told : list of Told
        Of each of its records.
    """
    found = Score()
    for one in told:
        if one.trouble is None:
            _score_healthy(found, stranger, one)
        else:
            _score_trouble(found, stranger, one)
    return found


def _score_healthy(found: Score, stranger: Stranger, told: Told) -> None:
    cycles = len(told.starts_ns)
    found.count("judged at all", len(told.cycles) >= JUDGED_FROM)
    found.count(f"judged at all: {stranger.kind}", len(told.cycles) >= JUDGED_FROM)
    alarms = len(told.findings)
    for name in ("false alarms in cycles", f"false alarms in cycles: {stranger.kind}"):
        share = found.shares.setdefault(name, [0, 0])
        share[0] += alarms
        share[1] += cycles


def _score_trouble(found: Score, stranger: Stranger, told: Told) -> None:
    trouble = told.trouble
    assert trouble is not None
    first = first_with(told)
    before = sum(number < first for number, _, _ in told.cycles)
    if not first or before + 1 < JUDGED_FROM:
        found.count("early: found", any(f.alarm >= first for f in told.findings))
        return
    rows, touched = [number for number, _, _ in told.cycles], touched_by(told)
    later = [
        (f, once)
        for f, once in zip(told.findings, told.at_once, strict=True)
        if f.alarm >= touched
    ]
    told_in = max(later[0][0].alarm, first) if later else 0
    delay = rows.index(told_in) - rows.index(first) + 1 if later else 0
    size, right = trouble.size, trouble.right(stranger.valve.kind)
    groups = (size, f"{size}: {stranger.kind}", f"{size}: {trouble.name}")
    for group in groups:
        found.count(f"{group}: within {WITHIN}", 0 < delay <= WITHIN)
        found.count(f"{group}: in the first cycle", delay == 1)
        if later:
            found.count(f"{group}: named right", _is_right(later[0][0], right))
            found.count(f"{group}: named right at once", _is_right(later[0][1], right))
            found.count(f"{group}: right or its rival", _is_right(later[0][0], right, also=True))
    found.delays.append(delay)


def _is_right(finding: Finding | None, right: tuple[str, ...], *, also: bool = False) -> bool:
    if finding is None:
        return False
    return finding.fault in right or (also and bool(set(finding.rivals) & set(right)))
