# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Find files in which the answer does not follow the command as it does in the others."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.solvers.arx import fit_arx
from valve_twin.core.prediction import fit_percent
from valve_twin.core.survey.choose import halve
from valve_twin.io.configure.channels import joined

if TYPE_CHECKING:
    from pathlib import Path

    from valve_twin.core.survey.choose import Pair
    from valve_twin.core.types import FloatArray
    from valve_twin.io.configure.channels import Survey

_LEAST_FILES = 3
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
        parts = [_columns(survey, at, pair) for at in range(len(survey.recordings))]
        fits = _fits(parts, pair.lag)
        odd = _odd(fits)
        if odd:
            return {
                survey.recordings[at].path: (
                    f"'{names[1]}' follows '{names[0]}' unlike in the other files: their models "
                    f"fit {fit:.0f} % of it, {usual:.0f} % of each other"
                )
                for at, (fit, usual) in odd.items()
            }
    return {}


def _columns(survey: Survey, at: int, pair: Pair) -> tuple[FloatArray, FloatArray, int] | None:
    """Return command and answer of one file on one grid, and its step; None = one rests."""
    names = {n: "" for n in (pair.command, pair.answer)}
    signals, _ = joined([survey.recordings[at]], survey.gap_s, names)
    if len(signals) < len(names):
        return None
    halves = halve(signals, pair.command, pair.answer)
    u = np.concatenate((halves.u, halves.unseen_u))
    return u, np.concatenate((halves.y, halves.unseen_y)), halves.every


def _fits(parts: list[tuple[FloatArray, FloatArray, int] | None], lag: int) -> FloatArray:
    """Return how well the model of a file (row) fits another (column) [%]; NaN = not known."""
    fits = np.full((len(parts), len(parts)), np.nan)
    for row, part in enumerate(parts):
        if part is None:
            continue
        reach = max(1, lag // part[2])
        model = fit_arx(part[0], part[1], (0, 1, reach // 2, reach, 2 * reach))
        if model is None:
            continue
        for column, other in enumerate(parts):
            if other is not None and column != row and other[2] == part[2]:
                fits[row, column] = fit_percent(other[1], model.free_run(other[0], other[1]))
    return fits


def _odd(fits: FloatArray) -> dict[int, tuple[float, float]]:
    """Return by file the fit of it by the others, and theirs by each other [%]."""
    sound = list(range(len(fits)))
    odd: dict[int, tuple[float, float]] = {}
    while len(sound) >= _LEAST_FILES:
        by_others = np.array([_median(np.delete(fits[sound, k], sound.index(k))) for k in sound])
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
