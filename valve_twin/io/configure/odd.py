# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Find files in which the answer does not follow the command as it does in the others."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from valve_twin.core.estimation.solvers.arx import fit_arx
from valve_twin.core.prediction import fit_percent
from valve_twin.io.configure.channels import joined

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from valve_twin.core.survey.choose import Pair
    from valve_twin.core.types import FloatArray
    from valve_twin.io.configure.channels import Survey

_LEAST_FILES = 3
_MOST_SAMPLES = 1500  # of a file that are looked at
_SOUND = 50.0  # fit of one file by the models of the others that shows how sound ones are [%]
_ODD = 0.0  # fit by the models of the others at and below which a file is odd [%]


def odd_files(survey: Survey, pairs: list[Pair]) -> dict[Path, str]:
    """Return the files that are unlike the others, and why, in words.

    An ARX model of each file runs freely through each other one. A file is odd where the models
    of the others follow it no better than its mean does while they follow each other, and where
    it is in the minority.

    Parameters
    ----------
    survey : Survey
        Channels of all files.
    pairs : list of Pair
        Commands and answers that may be meant; those of which most files say the same count.
    """
    if len(survey.recordings) < _LEAST_FILES:
        return {}
    for pair in pairs:
        names = (pair.command, pair.answer)
        parts, every = _columns(survey, pair)
        odd = _odd(_fits(parts, max(1, pair.lag // every)))
        if odd:
            return {
                survey.recordings[at].path: (
                    f"'{names[1]}' follows '{names[0]}' unlike in the other files: their models "
                    f"fit {fit:.0f} % of it, {usual:.0f} % of each other"
                )
                for at, (fit, usual) in odd.items()
            }
    return {}


def without(odd: Mapping[Path, str], survey: Survey) -> Survey:
    """Return a survey of the other files that says which were left out.

    Parameters
    ----------
    odd : mapping
        What `odd_files` returned.
    survey : Survey
        Of the others.
    """
    told = [f"{path}: {why}" for path, why in odd.items()]
    every = [*odd, *(r.path for r in survey.recordings)]
    names = tuple(dict.fromkeys(_shortest(path, every) for path in odd))
    return replace(survey, refused=[*told, *survey.refused], left_out=names)


def _shortest(path: Path, every: Sequence[Path]) -> str:
    """Return the shortest end of a path, its name or more, that no other file ends with."""
    parts = path.absolute().parts
    others = {p.absolute().parts for p in every} - {parts}
    for count in range(1, len(parts)):
        if all(other[-count:] != parts[-count:] for other in others):
            return "/".join(parts[-count:])
    return path.absolute().as_posix()


_Part: TypeAlias = "tuple[FloatArray, FloatArray]"


def _columns(survey: Survey, pair: Pair) -> tuple[list[_Part | None], int]:
    """Return command and answer of each file, None where one rests, and their common step."""
    names = {pair.command, pair.answer}
    each = [joined([r], survey.gap_s, names)[0] for r in survey.recordings]
    longest = max((len(s[pair.answer].values) for s in each if pair.answer in s), default=0)
    every = max(1, -(-longest // _MOST_SAMPLES))
    parts: list[_Part | None] = []
    for signals in each:
        if len(signals) < len(names):
            parts.append(None)
            continue
        command, answer = signals[pair.command], signals[pair.answer]
        at = np.searchsorted(command.stamp_ns, answer.stamp_ns[::every], side="right") - 1
        parts.append((command.values[np.maximum(at, 0)], answer.values[::every]))
    return parts, every


def _fits(parts: Sequence[_Part | None], reach: int) -> FloatArray:
    """Return how well the model of a file (row) fits another (column) [%]; NaN = not known."""
    fits = np.full((len(parts), len(parts)), np.nan)
    for row, part in enumerate(parts):
        model = part and fit_arx(*part, (0, 1, reach // 2, reach, 2 * reach))
        for column, other in enumerate(parts):
            if model and other and column != row:
                fits[row, column] = fit_percent(other[1], model.free_run(*other))
    return fits


def _odd(fits: FloatArray) -> dict[int, tuple[float, float]]:
    """Return by file the fit of it by the others, and theirs by each other [%]."""
    sound = list(range(len(fits)))
    odd: dict[int, tuple[float, float]] = {}
    while len(sound) >= _LEAST_FILES:
        by_others = np.array([_median(fits[sound, k]) for k in sound])
        known = np.where(np.isfinite(by_others), by_others, np.inf)
        worst = int(np.argmin(known))
        rest = [k for k in sound if k != sound[worst]]
        usual = _median(fits[np.ix_(rest, rest)])
        if not (known[worst] <= _ODD and usual >= _SOUND):
            break
        odd[sound[worst]] = float(known[worst]), usual
        sound = rest
    return odd if 2 * len(odd) < len(fits) else {}


def _median(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")
