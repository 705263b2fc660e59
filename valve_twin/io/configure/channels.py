# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The channels of files, one after the other, with what their names and units say."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.survey.pairs import Signal
from valve_twin.core.survey.record import MIN_SAMPLES
from valve_twin.io.errors import BagError
from valve_twin.io.instruments.clock import ClockChoice
from valve_twin.io.instruments.derived import with_derived
from valve_twin.io.instruments.read import read_recording
from valve_twin.io.instruments.units import known_unit, roles_of, split_name

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from valve_twin.io.instruments.table import Recording

MOST_FILES = 8
"""Files that are looked at; the import reads all."""

GAP_S = 5.0
"""Pause between two files, at least [s]."""

_GAP_PERIODS = 10.0


@dataclass(frozen=True, slots=True)
class Survey:
    """What was found in the files.

    Attributes
    ----------
    recordings : list of Recording
        Those that could be read.
    refused : list of str
        Why the others are left out, one line each.
    signals : dict
        Channels that change, all files after each other, by name.
    roles : dict
        What each channel may be, the most likely first.
    still : dict
        Channels that never change, and where they stay.
    sizes : dict
        What 1 of a channel is in SI, 1 where its unit is not known.
    period_s, jitter : float
        Usual step of the answer [s] and the share of steps off it by a tenth [1].
    gap_s : float
        Pause between files [s].
    made : dict
        Channels made from others, and the channel whose unit each has.
    clock : ClockChoice
        What was known of the time.
    left_out : tuple of str
        Names of files that were read and are unlike the others.
    """

    recordings: list[Recording]
    refused: list[str]
    signals: dict[str, Signal]
    roles: dict[str, tuple[str, ...]]
    still: dict[str, float]
    sizes: dict[str, float]
    period_s: float = 0.0
    jitter: float = 0.0
    gap_s: float = GAP_S
    made: Mapping[str, str] = field(default_factory=dict)
    clock: ClockChoice = field(default_factory=ClockChoice)
    left_out: tuple[str, ...] = ()


def look(paths: Sequence[Path], choice: ClockChoice) -> Survey:
    """Read files and put them after each other.

    Parameters
    ----------
    paths : sequence of path
        The first eight are read. One that cannot be read is left out.
    choice : ClockChoice
        What is known of the time.

    Raises
    ------
    BagError
        If none can be read.
    """
    recordings, refused = [], []
    for path in paths[:MOST_FILES]:
        try:
            recordings.append(read_recording(path, choice))
        except BagError as err:
            refused.append(str(err))
    if not recordings:
        raise BagError(refused[0])
    names = [c.name for c in recordings[0].columns]
    alike = []
    for recording in recordings:
        missing = set(names) - {c.name for c in recording.columns}
        if missing:
            refused.append(f"{recording.path}: has no channel '{min(missing)}' as the first file")
        else:
            alike.append(recording)
    steps = [np.diff(c.seconds) for r in alike for c in r.columns if len(c.seconds) > 1]
    usual = float(np.median(np.concatenate(steps))) if steps else 1.0
    gap_s = max(GAP_S, _GAP_PERIODS * usual)
    signals, still = joined(alike, gap_s)
    units = {c.name: c.unit for c in alike[0].columns}
    roles = {k: roles_of(*_parts(k, units[k])) for k in signals}
    known = {k: known_unit(_parts(k, units[k])[1]) for k in signals}
    sizes = {k: unit.size if unit else 1.0 for k, unit in known.items()}
    return Survey(alike, refused, signals, roles, still, sizes, gap_s=gap_s, clock=choice)


def add_channels(survey: Survey, made: Mapping[str, str], roles: tuple[str, ...]) -> Survey:
    """Return a survey with channels made from others.

    Parameters
    ----------
    survey : Survey
        Channels.
    made : mapping
        By the name of the new channel as `with_derived` takes it, the channel whose unit it has.
    roles : tuple of str
        What the new ones may be.
    """
    recordings = [with_derived(r, made) for r in survey.recordings]
    signals, _ = joined(recordings, survey.gap_s, made)
    return replace(
        survey,
        recordings=recordings,
        signals={**survey.signals, **signals},
        roles={**survey.roles, **dict.fromkeys(signals, roles)},
        sizes={**survey.sizes, **{k: survey.sizes[made[k]] for k in signals}},
        made={**survey.made, **made},
    )


def _parts(name: str, unit: str) -> tuple[str, str]:
    plain, own = split_name(name)
    return plain, unit or own


def joined(
    recordings: Sequence[Recording], gap_s: float, names: Iterable[str] | None = None
) -> tuple[dict[str, Signal], dict[str, float]]:
    """Put the channels of recordings after each other.

    Parameters
    ----------
    recordings : sequence of Recording
        With the same channels.
    gap_s : float
        Pause between two [s].
    names : iterable of str, optional
        Only these channels.

    Returns
    -------
    dict
        Channels that change, by name.
    dict
        Channels that never do, and where they stay.
    """
    wanted = None if names is None else set(names)
    signals: dict[str, Signal] = {}
    still: dict[str, float] = {}
    starts, at = [], 0.0
    for recording in recordings:
        starts.append(at)
        at += max(float(c.seconds[-1]) for c in recording.columns) + gap_s
    for column in recordings[0].columns:
        if wanted is not None and column.name not in wanted:
            continue
        own = [next(c for c in r.columns if c.name == column.name) for r in recordings]
        seconds = np.concatenate([s + c.seconds for s, c in zip(starts, own, strict=True)])
        values = np.concatenate([c.values for c in own])
        known = np.isfinite(values)
        if np.count_nonzero(known) < MIN_SAMPLES:
            continue
        values = values[known]
        if float(np.ptp(values)) == 0.0:
            still[column.name] = float(values[0])
            continue
        stamps = np.rint(seconds[known] * 1e9).astype(np.int64)
        signals[column.name] = Signal(column.name, stamps, values)
    return signals, still


def unit_of(survey: Survey, name: str) -> str:
    """Return the unit of a channel as it stands in the file, in small letters."""
    name = survey.made.get(name, name)
    column = next(c for c in survey.recordings[0].columns if c.name == name)
    return _parts(name, column.unit)[1].lower()
