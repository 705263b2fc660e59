# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The campaign of first cycles: presses with and without a stored reference of their sisters.

Each press is judged from its first cycle on, sound and with faults that begin in cycles 1 to 8,
by its own past alone and held against a reference that its sisters made.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.verdict import VerdictKind
from valve_twin.core.diagnosis.given.judged import seen_of
from valve_twin.core.diagnosis.given.reference import make_reference
from valve_twin.core.diagnosis.history import followed_features
from valve_twin.core.past.columns import past_of
from valve_twin.core.valves.registry import get_model
from valve_twin.validation.strangers.score import FIRST_JUDGED, LETTERS, Score, names_part_of
from valve_twin.validation.strangers.sisters import JUDGED_CYCLES, family
from valve_twin.validation.strangers.watch import MODEL, estimated

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from valve_twin.core.aging.assess import Assessment
    from valve_twin.core.diagnosis.given.reference import FeatureReference, Seen
    from valve_twin.core.types import Estimate
    from valve_twin.validation.strangers.sisters import Family
    from valve_twin.validation.strangers.troubles import Trouble
    from valve_twin.validation.strangers.watch import Setup

REFERENCE_BASE, REFERENCE_COUNT = 920_000, 40
"""Seeds that are scored, never tuned on."""

OWN = "/press/own"

_FROM = 8
"""First cycle in which something is said [1]."""

_LOOKS = (10, 15, JUDGED_CYCLES)
"""Cycles by which a fault is told, or not [1]."""

_NUMBER = re.compile(r"\d+(\.\d+)?")

_UNUSABLE = VerdictKind.RECORDING_UNUSABLE
_SILENT = (VerdictKind.NO_REFERENCE, VerdictKind.NOT_ENOUGH_DATA)

_SOUND_LOOKS = (8, 10, 12, 15, 20, 24)
"""Cycles in which a sound press is "ok", or not [1]."""


@dataclass(slots=True)
class FirstCycles:
    """A press and its sisters, and what was said of it.

    Attributes
    ----------
    family : Family
        The presses.
    refused : str
        Why the sisters make no reference, empty = they do.
    score : Score
        Shares.
    words : list of str
        With a reference, a letter a cycle: of the sound press from the eighth on, then of each
        fault in the cycles `_LOOKS`.
    why : Counter
        Reasons, without their numbers, for which nothing was said of the sound press after its
        tenth cycle.
    """

    family: Family
    refused: str = ""
    score: Score = field(default_factory=Score)
    words: list[str] = field(default_factory=list)
    why: Counter[str] = field(default_factory=Counter)


def meet_families(
    chosen: Sequence[int],
    setup: Setup,
    *,
    sisters: int,
    advance: Callable[[], None] = lambda: None,
) -> Iterator[FirstCycles]:
    """Judge the first cycles of the presses of some seeds, one by one.

    Parameters
    ----------
    chosen : sequence of int
        Seeds.
    setup : Setup
        How the twin is configured.
    sisters : int
        Of how many sisters a reference is made [1].
    advance : callable
        Called after each.
    """
    for seed in chosen:
        yield judge(family(seed, sisters), setup)
        advance()


def judge(presses: Family, setup: Setup) -> FirstCycles:
    """Judge the first cycles of a press, sound and with each of its faults.

    Parameters
    ----------
    presses : Family
        The press and its sisters.
    setup : Setup
        How the twin is configured.
    """
    found = FirstCycles(presses)
    try:
        reference = reference_of(presses, setup)
    except ValueError as err:
        found.refused = str(err)
    found.score.count("sisters make a reference", not found.refused)
    if found.refused:
        return found
    own = presses.own
    sound = estimated(own, setup)
    troubled = [estimated(replace(own, troubles=(t,)), setup) for t in presses.troubles]
    for name, given in (("with", reference), ("without", None)):
        held = replace(setup, aging=replace(setup.aging, reference=given))
        words = [_score_sound(found, name, said_in(range(_FROM, own.cycles + 1), sound, held))]
        for trouble, of in zip(presses.troubles, troubled, strict=True):
            words.append(_score_fault(found.score, name, trouble, said_in(_LOOKS, of, held)))
        found.words = found.words or words
    return found


def reference_of(presses: Family, setup: Setup) -> FeatureReference:
    """Return the reference that the sisters of a press make.

    Raises
    ------
    ValueError
        If they make none.
    """
    model = get_model(MODEL)
    shown = [(k, estimated(s, setup)) for k, s in enumerate(presses.sisters, 1)]
    found = [_seen(f"/press/v{k}", each) for k, each in shown]
    seen = [s for s in found if s is not None]
    if not seen:
        msg = "no sister has features"
        raise ValueError(msg)
    return make_reference(
        seen,
        name="sisters.reference",
        model=model.name,
        features=model.feature_set.names,
        period_s=presses.own.logger.period_s,
    )


def _seen(name: str, each: list[tuple[Estimate, ...]]) -> Seen | None:
    """Return the features of a sister; None where her record has none."""
    rows = followed_features(past_of([e for part in each for e in part]))
    return None if rows is None else seen_of(rows, get_model(MODEL), name)


def said_in(
    cycles: Iterable[int], each: list[tuple[Estimate, ...]], setup: Setup
) -> list[tuple[int, Assessment]]:
    """Return what is said in some cycles.

    Parameters
    ----------
    cycles : iterable of int
        Production cycles, counted from 1.
    each : list of tuple of Estimate
        Estimates by production cycle.
    setup : Setup
        How the twin is configured.
    """
    parameters = get_model(MODEL).parameters
    found = []
    for cycle in cycles:
        history = [e for part in each[:cycle] for e in part]
        said = assess(history, (), setup.aging, parameters=parameters, valve=OWN)
        found.append((cycle, said))
    return found


def _score_sound(found: FirstCycles, name: str, said: list[tuple[int, Assessment]]) -> str:
    """Score what is said of the sound press."""
    score, letters = found.score, ""
    for cycle, one in said:
        kind = one.verdict.kind
        letters += LETTERS[kind]
        if cycle in _SOUND_LOOKS:
            score.count(f"{name}: sound, ok at {cycle}", kind is VerdictKind.OK)
        if cycle >= FIRST_JUDGED:
            score.count(f"{name}: sound, no reference", kind is VerdictKind.NO_REFERENCE)
            score.count(f"{name}: sound, not enough data", kind is VerdictKind.NOT_ENOUGH_DATA)
        if name == "with" and cycle >= FIRST_JUDGED and kind in _SILENT:
            found.why[_NUMBER.sub("#", one.verdict.evidence)] += 1
    alarm = any(one.diagnosis.present is not None for _, one in said)
    score.count(f"{name}: sound press with an alarm", alarm)
    return letters


def _score_fault(
    score: Score, name: str, trouble: Trouble, said: list[tuple[int, Assessment]]
) -> str:
    """Score what is said of the press with a fault."""
    where = f"{name}: {trouble.size} from {'1' if trouble.onset == 1 else '2-8'}"
    for cycle, one in said:
        kind = one.verdict.kind
        score.count(f"{where}, told at {cycle}", kind.names_part or kind is _UNUSABLE)
        score.count(f"{where}, ok at {cycle}", kind is VerdictKind.OK)
        if cycle == _LOOKS[1] and kind.names_part:
            right = names_part_of(one, kind, trouble)
            score.count(f"{where}, right part of those told at {cycle}", right)
    return "".join(LETTERS[one.verdict.kind] for _, one in said)
