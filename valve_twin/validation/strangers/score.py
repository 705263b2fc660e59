# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Hold what was said of a stranger against the stranger itself.

Every figure is a share, hits of cases, so that strangers add up. A verdict is judged by cycle:

healthy         no fault now or in the last `GRACE` cycles: any part named is a false alarm, but
                for the valve where more than `WEAR_SHOWS` of the way to a limit is worn away or
                a stepwise aging has made a step, and for clocks that are told to be apart
faulty          a medium or large fault that began after cycle `EARLY`: "ok" is silent wrong; a
                part named must be that of a fault, or of wear that shows
early           the same for faults that began up to cycle `EARLY`, which have no reference: "no
                reference" is right
worn            beyond a service limit: "ok" is wrong

"recording unusable" is right of loggers of `FEW_BITS` and clocks apart, of others without a fault
a false alarm. "No reference" and "recording unusable" are counted apart from "not enough data".
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.verdict import VerdictKind
from valve_twin.core.diagnosis.table import BY_NAME, PAIRS
from valve_twin.validation.strangers.record import aged, gain, leak

if TYPE_CHECKING:
    from valve_twin.core.aging.assess import Assessment
    from valve_twin.core.aging.verdict import Trend
    from valve_twin.validation.strangers.draw import Stranger
    from valve_twin.validation.strangers.troubles import Trouble
    from valve_twin.validation.strangers.watch import Said

EARLY = 8
FIRST_JUDGED = 11
GRACE = 6
WEAR_SHOWS = 0.3
WORN = 1.05
FEW_BITS = 6
FOLLOWED = ("K_in", "K_out", "leak")
V_REF = 0.3
_AGED = {"r_in": "K_in", "r_out": "K_out", "leak": "leak"}
_LAYERS = ((3e-5, "1e-5"), (3e-4, "1e-4"), (2e-3, "1e-3"), (6e-3, "4e-3"), (np.inf, "1e-2"))
_FARTHEST = 3000.0
_LIFE_EVERY = 5
_LIFE_FROM = 20


@dataclass(slots=True)
class Score:
    """Shares by name, (hits, cases), and delays of detection [cycles], 0 = never."""

    shares: dict[str, list[float]] = field(default_factory=dict)
    delays: list[int] = field(default_factory=list)
    words: str = ""

    def count(self, name: str, hit: bool) -> None:
        """Count one case."""
        share = self.shares.setdefault(name, [0, 0])
        share[0] += int(hit)
        share[1] += 1

    def add(self, other: Score) -> None:
        """Add what another stranger gave."""
        for name, (hits, cases) in other.shares.items():
            share = self.shares.setdefault(name, [0, 0])
            share[0] += hits
            share[1] += cases
        self.delays += other.delays


def score(stranger: Stranger, said: list[Said]) -> Score:
    """Score everything that was said of a stranger.

    Parameters
    ----------
    stranger : Stranger
        The truth.
    said : list of Said
        What was said of each cycle.

    Returns
    -------
    Score
        Shares and delays.
    """
    found = Score()
    truth = _Truth(stranger, said)
    _score_verdicts(found, stranger, said, truth)
    for one in said:
        _score_estimates(found, stranger, one)
        _score_trends(found, stranger, one, truth)
    return found


def _is_big(trouble: Trouble) -> bool:
    return trouble.size != "small"


class _Truth:
    """What a stranger's aging does to the followed parameters, without faults and scatter."""

    def __init__(self, stranger: Stranger, said: list[Said]) -> None:
        self._stranger = stranger
        commands = [e.value("v_in_mean") for s in said for e in s.estimates if e.used_by_trend]
        commands = [v for v in commands if v > 0.0]
        self._v_in = float(np.median(commands)) if commands else 0.5
        self._known: dict[float, tuple[float, float, float]] = {}
        self.reference = tuple(
            float(np.mean([self.at(c)[i] for c in range(1, 11)])) for i in range(3)
        )

    def at(self, cycle: float) -> tuple[float, float, float]:
        """Return K_in, K_out and leak in a cycle."""
        if cycle not in self._known:
            press, period = aged(self._stranger, cycle), self._stranger.logger.period_s
            self._known[cycle] = (
                gain(press, self._v_in, period),
                gain(press, V_REF, period, outflow=True),
                leak(press),
            )
        return self._known[cycle]

    def drift(self, cycle: float, index: int) -> float:
        """Return the change against the first ten cycles [%]."""
        return 100.0 * (self.at(cycle)[index] / self.reference[index] - 1.0)

    def wear(self, cycle: float) -> float:
        """Return the greatest share of the way to a service limit [1]."""
        limits = (15.0, 20.0, 20.0)
        return max(abs(self.drift(cycle, i)) / limits[i] for i in range(3))

    def crossing(self, cycle: float, index: int, limit: float) -> float:
        """Return the cycles left until a parameter is beyond its limit [%], infinite = never."""

        def beyond(left: float) -> bool:
            drift = self.drift(cycle + left, index)
            return drift <= limit if limit < 0.0 else drift >= limit

        if beyond(0.0):
            return 0.0
        low, high = 0.0, 1.0
        while not beyond(high):
            low, high = high, 2.0 * high
            if high > _FARTHEST:
                return float("inf")
        while high - low > 0.05:
            middle = 0.5 * (low + high)
            low, high = (low, middle) if beyond(middle) else (middle, high)
        return high


LETTERS = dict(zip(VerdictKind, "novcspru", strict=True))
"""Of a verdict: the part (v, c, s, p), ok, or why nothing is named (n, r, u)."""


def _score_verdicts(found: Score, stranger: Stranger, said: list[Said], truth: _Truth) -> None:
    kinds: list[VerdictKind] = []
    for one in said:
        verdict = one.assessment.verdict if one.assessment else None
        kind = verdict.kind if verdict else VerdictKind.NOT_ENOUGH_DATA
        kinds.append(kind)
        found.words += LETTERS[kind]
        _score_cycle(found, stranger, one, kind, truth.wear(one.cycle))
    _score_flicker(found, stranger)
    for trouble in stranger.troubles:
        if _is_big(trouble) and trouble.onset >= FIRST_JUDGED:
            end = trouble.end or stranger.cycles + 1
            told = [
                c for c in range(trouble.onset, end) if _names(said[c - 1], kinds[c - 1], trouble)
            ]
            found.delays.append(told[0] - trouble.onset + 1 if told else 0)
            found.count(f"detected: {trouble.name}", bool(told))


def _score_cycle(
    found: Score, stranger: Stranger, one: Said, kind: VerdictKind, wear: float
) -> None:
    """Judge the verdict of one cycle."""
    active = [t for t in stranger.troubles if t.at(one.cycle)]
    recent = [t for t in stranger.troubles if t.end and t.end <= one.cycle < t.end + GRACE]
    big = [t for t in active if _is_big(t)]
    early = any(t.onset <= EARLY for t in big)
    late = one.cycle >= FIRST_JUDGED
    silent, word = kind is VerdictKind.OK, LETTERS[kind]
    unusable = stranger.logger.bits <= FEW_BITS or bool(stranger.logger.clocks_apart)
    if not active and not recent:
        named = kind.names_part
        fair = kind is VerdictKind.VALVE and (wear >= WEAR_SHOWS or _has_stepped(stranger, one))
        fair |= bool(stranger.logger.clocks_apart) and _fault(one) == "clock"
        named |= word == "u"
        fair |= word == "u" and unusable
        found.count("false alarm", named and not fair)
        if late:
            found.count("no reference in a healthy cycle", word == "r")
    if late and not early:
        found.count("not enough data", word == "n")
        found.count("recording unusable", word == "u")
    if big and late:
        found.count("early: silent wrong" if early else "silent wrong", silent)
        if early:
            found.count("early: no reference", word == "r")
        since = min(t.onset for t in big)
        if not early and one.cycle >= since + 2:
            found.count("silent wrong from the third cycle", silent)
            for t in big:
                found.count(f"silent wrong: {t.name}", silent)
    if big and kind.names_part:
        right = any(_names(one, kind, t) for t in active)
        right |= kind is VerdictKind.VALVE and wear >= WEAR_SHOWS
        found.count("early: right part" if early else "right part", right)
        if not early:
            for t in big:
                found.count(f"right part: {t.name}", right)
    if late and not active and not recent and wear >= WORN:
        found.count("worn told ok", silent)


def _has_stepped(stranger: Stranger, one: Said) -> bool:
    aging = stranger.aging
    return aging.law == "stepwise" and any(c <= one.cycle for c in aging.steps)


def _fault(one: Said) -> str:
    return one.assessment.verdict.fault if one.assessment else ""


def _names(one: Said, kind: VerdictKind, trouble: Trouble) -> bool:
    return names_part_of(one.assessment, kind, trouble)


def names_part_of(assessment: Assessment | None, kind: VerdictKind, trouble: Trouble) -> bool:
    """Return whether a verdict names the part of a fault, alone or as one of a published pair.

    Parameters
    ----------
    assessment : Assessment or None
        What was said.
    kind : VerdictKind
        The verdict.
    trouble : Trouble
        The fault.
    """
    if not kind.names_part:
        return False
    if kind.text == trouble.part:
        return True
    finding = assessment.diagnosis.present if assessment else None
    if finding is None or len(finding.rivals) != 1:
        return False
    both = frozenset({finding.fault, *finding.rivals})
    return both in PAIRS and any(BY_NAME[n].part == trouble.part for n in both)


def _score_flicker(found: Score, stranger: Stranger) -> None:
    """Count verdicts that come back within five cycles while nothing happened."""
    happened = [t.onset for t in stranger.troubles] + [t.end for t in stranger.troubles if t.end]
    words = found.words
    for i in range(FIRST_JUDGED, len(words)):
        quiet = all(not i - GRACE < c <= i + 1 for c in happened)
        if quiet:
            back = words[i] != words[i - 1] and words[i] in words[max(i - 5, 10) : i - 1]
            found.count("flicker", back)


def _score_estimates(found: Score, stranger: Stranger, one: Said) -> None:
    """Count how many intervals of single cycles hold the press's own gain."""
    if any(t.at(one.cycle) and t.part in {"sensor", "command"} for t in stranger.troubles):
        return
    layer = next(name for limit, name in _LAYERS if stranger.logger.sigma < limit)
    period = stranger.logger.period_s
    for e in one.estimates:
        at = e.value("v_in_mean")
        for p in e.parameters:
            if p.name not in FOLLOWED or not np.isfinite(p.lower_95 + p.upper_95):
                continue
            if p.name == "K_in":
                true = gain(one.present, at, period)
            elif p.name == "K_out":
                true = gain(one.present, V_REF, period, outflow=True)
            else:
                true = leak(one.present)
            held = p.lower_95 <= true <= p.upper_95
            found.count(f"cycle interval: {e.estimator} {p.name} at {layer}", held)


def _score_trends(found: Score, stranger: Stranger, one: Said, truth: _Truth) -> None:
    """Count how many intervals of drift and remaining life hold the truth."""
    if one.assessment is None or any(t.onset <= one.cycle for t in stranger.troubles):
        return
    for trend in one.assessment.trends:
        if trend.parameter not in FOLLOWED:
            continue
        index = FOLLOWED.index(trend.parameter)
        low, high = trend.drift_reference_lower_95, trend.drift_reference_upper_95
        if np.isfinite(low + high):
            held = low <= truth.drift(one.cycle, index) <= high
            found.count(f"drift interval: {trend.parameter}", held)
        due = one.cycle >= _LIFE_FROM and one.cycle % _LIFE_EVERY == 0
        if due and np.isfinite(trend.threshold) and trend.reference:
            _score_life(found, stranger, one, trend, truth)


def _score_life(found: Score, stranger: Stranger, one: Said, trend: Trend, truth: _Truth) -> None:
    index = FOLLOWED.index(trend.parameter)
    limit = 100.0 * (trend.threshold / trend.reference - 1.0)
    left = truth.crossing(one.cycle, index, limit)
    own = _AGED[stranger.aging.part] == trend.parameter
    law = stranger.aging.law if own else "none"
    told = np.isfinite(trend.remaining_high)
    if law != "none":
        found.count(f"life told: {law}", bool(told))
    if told:
        held = trend.remaining_low <= left <= trend.remaining_high
        found.count(f"life interval: {law}", bool(held))
        found.count("life interval", bool(held))
