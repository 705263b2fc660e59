# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A valve of which a command and two limit switches are recorded, and no position."""

from __future__ import annotations

from itertools import permutations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.survey.cycles import plan_cycles
from valve_twin.core.survey.pairs import Signal
from valve_twin.core.survey.repeats import Repeat
from valve_twin.core.valves.registry import get_model, model_names
from valve_twin.io.configure.channels import add_channels

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.types import FloatArray, IntArray
    from valve_twin.io.configure.channels import Survey

_LEAST_STROKES = 3
_TURNS = 0.9  # share of the switchings that come in turn, assumed
_BOTH = 0.01  # share of the samples in which both ends may be reported, assumed
_ROOM = 2.0  # dead and stroke times that the middle of a slower stroke is looked for, assumed
_APART = 0.45  # share of the way to the next stroke that is looked at, assumed
_EDGE = 0.1  # share of a rest at its ends that is not called steady, assumed


class Switches(NamedTuple):
    """Channels: the command, the switch of the end that it drives to, and that of the other."""

    command: str
    there: str
    back: str


class _Stroke(NamedTuple):
    """Of a mean cycle: first sample in motion, first at its end, first in motion again."""

    leaves: int
    arrives: int
    returns: int


def find_switches(survey: Survey) -> tuple[Survey, Repeat] | None:
    """Return the timing of strokes between two limit switches, None where that is not all.

    Parameters
    ----------
    survey : Survey
        Channels.

    Returns
    -------
    Survey
        With the sum of both switches, 0 in motion.
    Repeat
        What is followed of it.
    """
    signals = survey.signals
    binary = {k: s.values for k, s in signals.items() if set(np.unique(s.values)) == {0.0, 1.0}}
    measured = [k for k in signals if k not in binary and "position" in survey.roles.get(k, ())]
    counts = {len(v) for v in binary.values()}
    if measured or len(binary) < len(Switches._fields) or len(counts) > 1:
        return None
    rises = {k: _rises(v) for k, v in binary.items()}
    moved = {k: v for k, v in binary.items() if len(rises[k]) >= _LEAST_STROKES}
    found = [
        (late, Switches(command, there, back))
        for there, back in permutations(moved, 2)
        if float(np.mean((moved[there] > 0.0) & (moved[back] > 0.0))) <= _BOTH
        for command in moved.keys() - {there, back}
        if (late := _delay(moved[command], *(rises[k] for k in (command, there, back))))
        is not None
    ]
    models = [m for m in map(get_model, model_names()) if not m.inputs]
    if not found or not models:
        return None
    switches = min(found)[1]
    channel = f"{switches.there} + {switches.back}"
    survey = add_channels(survey, {channel: switches.there}, ())
    command = signals[switches.command]
    period_s = float(np.median(np.diff(command.stamp_ns))) * 1e-9
    given = Signal("command", command.stamp_ns, command.values)
    plan = plan_cycles([given], period_s, has_counter=False)
    mean = _mean_cycle(1.0 - survey.signals[channel].values, _rises(command.values))
    stroke = _stroke(mean)
    if stroke is None or channel not in survey.signals:
        return None
    options = _options(mean, stroke, period_s)
    cycle_s = len(mean) * period_s
    return survey, Repeat(
        channel, cycle_s, 1.0, models[0].name, options, plan, -1.0, 1.0, switches.command
    )


def _rises(values: FloatArray) -> IntArray:
    return np.flatnonzero(np.diff(values) > 0.0) + 1


def _delay(
    command: FloatArray, asked: IntArray, reached: IntArray, left: IntArray
) -> float | None:
    """Return how long after its command an end is reached [samples], None = it is not one's."""
    at = np.searchsorted(asked, reached, side="left") - 1
    turns = np.count_nonzero(np.diff(at) == 1) + 1
    driven = command[np.maximum(reached - 1, 0)] > 0.0
    leaves = command[np.maximum(left - 1, 0)] > 0.0
    if turns < _TURNS * len(reached) or np.mean(driven) < _TURNS or np.mean(leaves) > 1.0 - _TURNS:
        return None
    return float(np.median(reached - asked[np.maximum(at, 0)]))


def _mean_cycle(moving: FloatArray, starts: IntArray) -> FloatArray:
    n = int(np.diff(starts).min())
    return np.asarray(np.mean([moving[a : a + n] for a in starts if a + n <= len(moving)], axis=0))


def _stroke(mean: FloatArray) -> _Stroke | None:
    """Return the first stroke of a mean cycle, None where it does not begin and end in it."""
    edges = np.flatnonzero(np.diff((mean > 0.5).astype(np.int8))) + 1
    if mean[0] > 0.5 or len(edges) < 2:
        return None
    some = np.flatnonzero(mean[edges[1] :] > 0.0)
    held = some[some > _LEAST_STROKES]
    rest = int(edges[1]) + (int(held[0]) if len(held) else len(mean) - int(edges[1]))
    return _Stroke(int(edges[0]), int(edges[1]), rest)


def _options(mean: FloatArray, stroke: _Stroke, period_s: float) -> Mapping[str, object]:
    """Return where the middle of the stroke is looked for, and where the valve rests behind it."""
    moving = mean[: stroke.returns]
    middle = float(np.arange(len(moving)) @ moving / moving.sum())
    apart = stroke.returns - middle
    half = min(_ROOM * stroke.arrives, _APART * apart)
    margin = _EDGE * (stroke.returns - stroke.arrives)
    return {
        "between_ends": True,
        "spike_start_s": 0.0,
        "spike_end_s": (stroke.returns - half - 1.0) * period_s,
        "spike_half_width_s": half * period_s,
        "steady_start_s": (stroke.arrives + margin) * period_s,
        "steady_end_s": (stroke.returns - margin) * period_s,
        "healthy_instant_s": middle * period_s,
    }
