# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Channels that no file holds but two of it make: a difference, the two sides of a command."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.survey.choose import ANSWERS, compare_pair
from valve_twin.core.survey.pairs import Views, find_driven
from valve_twin.core.survey.record import propose
from valve_twin.io.configure.channels import add_channels, unit_of
from valve_twin.io.instruments.derived import difference, one_side

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.survey.choose import Pair
    from valve_twin.core.survey.record import Proposal
    from valve_twin.core.types import BoolArray
    from valve_twin.io.configure.channels import Survey

_PRESSURE = ANSWERS[1]
_MOST = 6  # channels whose differences are tried
_BETTER = 10.0  # points of the ARX fit that a difference has to be worth, assumed [%]
_BOTH = 0.1  # share of its largest value that a bipolar command reaches on both sides
_REST, _RESTS = 0.02, 0.1  # of that value, and share of the record that it lies below
_DRIVES = 0.5  # correlation with the rate of the answer, each side alone, assumed
_STILL = 0.02  # share of its range that it moves in the second half of a rest, assumed
_APART = 0.3  # share of its range that the answer stays apart at rests; what follows comes back


def better_difference(
    survey: Survey, pairs: Sequence[Pair], copies: Mapping[str, str]
) -> tuple[Survey, list[Pair]]:
    """Return pairs, first the difference of two pressures where it answers clearly better.

    Parameters
    ----------
    survey : Survey
        Channels.
    pairs : sequence of Pair
        What was found, the best first.
    copies : mapping
        Channels that are none.
    """
    roles = survey.roles
    kind = (*roles.get(pairs[0].answer, ()), "")[0] if pairs else _PRESSURE
    names = [k for k in survey.signals if roles.get(k, ())[:1] == (_PRESSURE,) and k not in copies]
    commands = [k for k in survey.signals if "command" in roles.get(k, ()) and k not in names]
    if kind != _PRESSURE or not 2 <= len(names) <= _MOST or not commands:
        return survey, list(pairs)
    made = {
        difference(a, b): (a, b)
        for a, b in combinations(names, 2)
        if unit_of(survey, a) == unit_of(survey, b)
    }
    tried = add_channels(survey, {name: a for name, (a, _) in made.items()}, (_PRESSURE,))
    found = [
        pair
        for name in made
        if name in tried.signals
        for command in commands[:2]
        if (pair := compare_pair(tried.signals, command, name)) is not None
        and np.isfinite(pair.arx)
    ]
    least = max((p.arx for p in pairs if np.isfinite(p.arx)), default=0.0) + _BETTER
    best = max(found, key=lambda p: p.arx, default=None)
    if best is None or best.arx < least:
        return survey, list(pairs)
    first, second = made[best.answer]
    if best.correlation < 0.0:
        name = difference(second, first)
        added = add_channels(survey, {name: first}, (_PRESSURE,))
        turned = compare_pair(added.signals, best.command, name)
        return (added, [turned, *pairs]) if turned is not None else (survey, list(pairs))
    return add_channels(survey, {best.answer: first}, (_PRESSURE,)), [best, *pairs]


def split_command(survey: Survey, pair: Pair) -> tuple[Survey, Proposal] | None:
    """Return the two sides of a command that rests at 0 and drives the answer both ways.

    Parameters
    ----------
    survey : Survey
        Channels.
    pair : Pair
        Command and answer.
    """
    u = survey.signals[pair.command].values
    largest = float(np.abs(u).max())
    if u.min() > -_BOTH * largest or u.max() < _BOTH * largest:
        return None
    resting = np.abs(u) < _REST * largest
    if float(np.mean(resting)) < _RESTS or not _stays(survey, pair, resting):
        return None
    sides = [one_side(pair.command), one_side(pair.command, falling=True)]
    added = add_channels(survey, dict.fromkeys(sides, pair.command), ("command",))
    signals = {k: added.signals[k] for k in (pair.answer, *sides)}
    found = find_driven(Views(signals), [pair.answer])
    if found is None or min(found.rising, -found.falling) < _DRIVES:
        return None
    proposal = propose(signals, position=pair.answer)
    return None if proposal is None else (added, proposal)


def _stays(survey: Survey, pair: Pair, resting: BoolArray) -> bool:
    """Whether the answer stays where it was driven when the command goes back to rest."""
    command, answer = survey.signals[pair.command], survey.signals[pair.answer]
    edges = np.diff(np.concatenate(([0], resting.astype(np.int8), [0])))
    first, last = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0) - 1
    middle = (first + last + 1) // 2
    held = [
        answer.values[np.maximum(np.searchsorted(answer.stamp_ns, t, side="right") - 1, 0)]
        for t in (command.stamp_ns[middle], command.stamp_ns[last])
    ]
    span = float(np.ptp(answer.values))
    moved = float(np.median(np.abs(held[1] - held[0])))
    return len(first) > 1 and moved < _STILL * span and float(np.ptp(held[1])) > _APART * span
