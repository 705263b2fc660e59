# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which columns of an unknown record are command and answer: names, units, causality, ARX fits."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import nan
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.solvers.arx import fit_arx, line_fit
from valve_twin.core.prediction import fit_percent
from valve_twin.core.survey.pairs import Match, Signal, Views, match_increments, match_levels

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.types import FloatArray

ANSWERS = ("position", "oil pressure", "volume flow", "current")
"""What may answer a command, what a valve is best judged by first; each ends as signals do."""

_NEVER = frozenset({"temperature", "time", "count"})
_COPY = (
    0.002  # rms distance from the command, in its range, that no sensor of its own has, assumed
)
_LATE_COPY = 2e-4  # likewise of a command some samples ago, assumed
_FOLLOWS = 0.5  # correlation of the levels where names say the same, assumed
_MOST_SAMPLES = 3000  # of a trial
_LEAST_CYCLES, _MOST_CYCLES = 2, 12  # of a trial by cycles
_LEAST_TESTED = 2  # later cycles that tell models apart, assumed
_PAUSED = 3.0  # median lengths of a cycle beyond which one holds a pause, assumed
_WORTH = 20.0  # ARX fit of a pair worth a model [%], assumed
_CLEAR = 0.5  # correlation of the increments that is enough where names say the same, assumed
_PAIRS = 3  # pairs tried with models
_QUIET = 0.05  # a pair this much worse than the best is not preferred for its clean command


@dataclass(frozen=True, slots=True)
class Pair:
    """A command and what answers it.

    Attributes
    ----------
    command, answer : str
        Columns.
    lag : int
        Samples of the answer.
    correlation : float
        Of their increments, or of the answer's with the command's sum [1]; negative = the
        answer falls as the command rises.
    arx, line : float
        Free-run fit of an ARX model and fit of a line through the command, on unseen samples [%].
    named : bool
        Whether names or units say so, too.
    """

    command: str
    answer: str
    lag: int
    correlation: float
    arx: float
    line: float
    named: bool


@dataclass(frozen=True, slots=True)
class Halves:
    """Command and answer on one grid, the first half to train on, the second to test on.

    Attributes
    ----------
    every : int
        Samples of the answer a step [1].
    u, y, unseen_u, unseen_y : (N,) arrays
        Commands and answers.
    first : int
        Sample of the answer with which the first half begins [1].
    begins, unseen_begins : tuple of int
        Samples at which cycles begin, each with a free run of its own; empty = one for all [1].
    """

    every: int
    u: FloatArray
    y: FloatArray
    unseen_u: FloatArray
    unseen_y: FloatArray
    first: int = 0
    begins: tuple[int, ...] = ()
    unseen_begins: tuple[int, ...] = ()

    @property
    def doubt(self) -> str:
        """Why a comparison by cycles says little; empty where it does not."""
        few = self.begins and len(self.unseen_begins) < _LEAST_TESTED
        return "models were held against a single later cycle; give a longer part" if few else ""


def halve(signals: Mapping[str, Signal], command: str, answer: str) -> Halves:
    """Return two columns on the answer's stamps, thinned, in two halves that both move.

    Parameters
    ----------
    signals : mapping
        Columns by name.
    command, answer : str
        Which.
    """
    grid = signals[answer].stamp_ns
    every = max(1, -(-len(grid) // _MOST_SAMPLES))
    at = np.searchsorted(signals[command].stamp_ns, grid[::every], side="right") - 1
    u = signals[command].values[np.maximum(at, 0)]
    y = signals[answer].values[::every]
    way = np.cumsum(np.abs(np.diff(u, prepend=u[:1])))
    middle = int(np.searchsorted(way, 0.5 * way[-1]))
    half = min(max(middle, len(y) // 4), 3 * len(y) // 4)
    return Halves(every, u[:half], y[:half], u[half:], y[half:])


def halve_cycles(
    signals: Mapping[str, Signal], command: str, answer: str, opened_ns: Sequence[int]
) -> Halves | None:
    """Return the first cycles of two columns, thinned only where few are long; None = too few.

    Those that hold a pause are left out: they would leave no room for others.

    Parameters
    ----------
    signals : mapping
        Columns by name.
    command, answer : str
        Which.
    opened_ns : sequence of int
        Where cycles begin [ns].
    """
    grid, y = signals[answer].stamp_ns, signals[answer].values
    edges = np.searchsorted(grid, opened_ns)
    length = np.diff(edges)
    if not len(length):
        return None
    kept = np.flatnonzero(length <= _PAUSED * np.median(length))[:_MOST_CYCLES]
    count = int(np.count_nonzero(np.cumsum(length[kept]) <= 2 * _MOST_SAMPLES))
    kept = kept[: max(count, _LEAST_CYCLES)]
    if len(kept) < _LEAST_CYCLES:
        return None
    every = max(1, -(-int(length[kept].sum()) // (2 * _MOST_SAMPLES)))
    parts = [np.arange(edges[k], edges[k + 1], every) for k in kept]
    part = np.concatenate(parts)
    at = np.searchsorted(signals[command].stamp_ns, grid[part], side="right") - 1
    u, y = signals[command].values[np.maximum(at, 0)], y[part]
    begins = np.cumsum([0, *map(len, parts[:-1])]).tolist()
    middle = (len(begins) + 1) // 2
    half = begins[middle]
    return Halves(
        every, u[:half], y[:half], u[half:], y[half:], int(part[0]),
        tuple(begins[:middle]), tuple(b - half for b in begins[middle:]),
    )  # fmt: skip


def choose_pairs(
    signals: Mapping[str, Signal], roles: Mapping[str, Sequence[str]], *, position: str = ""
) -> tuple[list[Pair], dict[str, str]]:
    """Return the best pairs of command and answer, best first, and what was refused.

    Parameters
    ----------
    signals : mapping
        Columns that change, by name.
    roles : mapping
        What each may be by its name and unit, the most likely first; empty = unknown.
    position : str
        The answer, where it is known.

    Returns
    -------
    list of Pair
        At most three; empty where nothing answers anything.
    dict
        By channel, why it was refused: it is a copy of another.
    """
    usable = {k: s for k, s in signals.items() if not _NEVER.intersection(roles.get(k, ())[:1])}
    views = Views(usable)
    refused: dict[str, str] = {}
    copied: set[frozenset[str]] = set()
    for commands, answers, named in _levels(list(views.signals), roles, position):
        found = []
        for answer in answers:
            for command in (c for c in commands if c != answer):
                if frozenset((command, answer)) in copied:
                    continue
                pair = _pair(usable, views, command, answer, named=named)
                if isinstance(pair, str):
                    refused[answer] = pair
                    copied.add(frozenset((command, answer)))
                elif pair is not None:
                    found.append(pair)
        good = [p for p in found if p.arx >= _WORTH or (named and abs(p.correlation) >= _CLEAR)]
        if good:
            return _ranked(good, usable)[:_PAIRS], refused
    return [], refused


def compare_pair(signals: Mapping[str, Signal], command: str, answer: str) -> Pair | None:
    """Return how one named column answers another, None where it does not or is a copy.

    Parameters
    ----------
    signals : mapping
        Columns that change, by name.
    command, answer : str
        Which.
    """
    both = {k: signals[k] for k in (command, answer)}
    pair = _pair(both, Views(both), command, answer, named=True)
    return pair if isinstance(pair, Pair) else None


def _levels(
    names: Sequence[str], roles: Mapping[str, Sequence[str]], position: str
) -> list[tuple[list[str], list[str], bool]]:
    """Return commands and answers to try: as named first, then any."""
    first = {k: (list(roles.get(k, ())) or [""])[0] for k in names}
    commands = [k for k in names if "command" in roles.get(k, ()) and k != position]
    driving = [k for k in names if first[k] in {"current", "voltage"}]
    levels: list[tuple[list[str], list[str], bool]] = []
    for kind in ANSWERS:
        answers = [k for k in names if first[k] == kind]
        answers = [k for k in answers if k == position] if position else answers
        levels += [(c, answers, True) for c in (commands, driving) if c and answers]
    answers = [position] if position else [k for k in names if k not in commands]
    levels += [(commands, answers, False)] if commands else []
    levels.append((list(names), [position] if position else list(names), False))
    return levels


def _pair(
    signals: Mapping[str, Signal], views: Views, command: str, answer: str, *, named: bool
) -> Pair | str | None:
    """Return a pair, why it is refused, or None where the answer does not follow."""
    view = views.of(answer)
    u, y = view.columns[command], view.columns[answer]
    if float(np.ptp(u)) == 0.0 or float(np.ptp(y)) == 0.0:
        return None
    if _misses(u, y, 0) < _COPY:
        return f"'{answer}' is a copy of '{command}': no answer that a sensor measured"
    matches = [(s, m) for s in (1.0, -1.0) if (m := match_increments(u, s * y, view.max_lag))]
    both = [(s, m) for s, m in matches if m.lag >= 0]
    if not matches and named:  # few and slow answers: increments show nothing
        both = [(s, m) for s in (1.0, -1.0) if (m := match_levels(u, s * y, view.max_lag))]
        both = [(s, m) for s, m in both if m.correlation >= _FOLLOWS]
    sign, match = max(both, key=_well, default=(1.0, None))
    if match is None:
        return None
    correlation, lag = sign * match.correlation, match.lag * view.every
    if _misses(u, y, match.lag) < _LATE_COPY:
        late = f"'{command}', {lag} samples late" if lag else f"'{command}'"
        return f"'{answer}' is a copy of {late}: no answer that a sensor measured"
    return _with_baselines(signals, Pair(command, answer, lag, correlation, nan, nan, named))


def _well(found: tuple[float, Match]) -> float:
    return found[1].correlation


def _misses(u: FloatArray, y: FloatArray, lag: int) -> float:
    """Return by how much a line through a late command misses the answer, rms in its range."""
    before, after = u[: len(u) - lag], y[lag:]
    span = float(np.ptp(after))
    if span == 0.0 or float(np.ptp(before)) == 0.0:
        return nan
    gain, level = np.polyfit(before, after, 1)
    return float(np.sqrt(np.mean((after - gain * before - level) ** 2))) / span


def _with_baselines(signals: Mapping[str, Signal], pair: Pair) -> Pair:
    """Return a pair with the fits of ARX and of a line."""
    return with_baselines(halve(signals, pair.command, pair.answer), pair)


def with_baselines(halves: Halves, pair: Pair) -> Pair:
    """Return a pair with the fits of ARX and of a line.

    Parameters
    ----------
    halves : Halves
        Its command and answer.
    pair : Pair
        Without them.
    """
    reach = max(1, pair.lag // halves.every)
    model = fit_arx(halves.u, halves.y, (0, 1, reach // 2, reach, 2 * reach))
    arx = nan
    if model is not None:
        cuts = list(halves.unseen_begins[1:])
        both = (np.split(x, cuts) for x in (halves.unseen_u, halves.unseen_y))
        run = [model.free_run(u, y) for u, y in zip(*both, strict=True)]
        arx = fit_percent(halves.unseen_y, np.concatenate(run))
    line = line_fit(halves.u, halves.y, halves.unseen_u, halves.unseen_y)
    return replace(pair, arx=arx, line=line)


def find_integrated(
    signals: Mapping[str, Signal],
    roles: Mapping[str, Sequence[str]],
    *,
    position: str = "",
    nameless: bool = False,
) -> Pair | None:
    """Return a command and the position that integrates it; None = none.

    Parameters
    ----------
    signals : mapping
        Columns that change, by name.
    roles : mapping
        What each may be by its name and unit, the most likely first.
    position : str
        The answer, where it is known.
    nameless : bool
        Whether columns whose names say nothing are tried, too.
    """
    views = Views(signals)
    unsaid = [k for k in views.signals if nameless and not roles.get(k, ())]
    commands = [k for k in views.signals if "command" in roles.get(k, ())] + unsaid
    answers = [k for k in views.signals if "position" in roles.get(k, ()) and k not in commands]
    answers += unsaid
    found = []
    for answer in [k for k in answers if k == position] if position else answers:
        view = views.of(answer)
        for command in (c for c in commands if c != answer):
            u = view.columns[command]
            total = np.concatenate(([0.0], np.cumsum(u - np.median(u))[:-1]))
            for way in (1.0, -1.0):
                match = match_increments(way * total, view.columns[answer], view.max_lag)
                if match is not None and match.correlation > _CLEAR and match.lag >= 0:
                    lag = match.lag * view.every
                    named = command not in unsaid and answer not in unsaid
                    pair = Pair(command, answer, lag, way * match.correlation, nan, nan, named)
                    found.append(pair)
    if not found:
        return None
    return _with_baselines(signals, max(found, key=lambda p: abs(p.correlation)))


def _ranked(pairs: Sequence[Pair], signals: Mapping[str, Signal]) -> list[Pair]:
    """Return pairs by their fit; of those as good, first the command that carries no noise."""
    best = max(p.arx if np.isfinite(p.arx) else 0.0 for p in pairs)

    def rank(pair: Pair) -> tuple[bool, bool, float]:
        near = pair.arx > best - 100.0 * _QUIET
        clean = near and _clean(signals[pair.command].values)
        return not clean, not (near and pair.correlation > 0.0), -pair.arx

    return sorted(pairs, key=rank)


def _clean(values: FloatArray) -> bool:
    """Whether a column rests without noise as a number of a controller does."""
    return float(np.mean(np.diff(values) == 0.0)) > 0.3
