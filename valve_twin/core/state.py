# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the way of a sample remembers, as plain values: the states of its parts.

Each part gives its state by `snapshot` and goes on from one by `restore` with the same bits. A
state shares the arrays of the samples with the part that gave it; neither writes into them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from valve_twin.core.types import join_frames

if TYPE_CHECKING:
    from collections.abc import Iterable

    from valve_twin.core.cycle_rules import RuleState
    from valve_twin.core.estimation.cycle.memory import InForce, Memory
    from valve_twin.core.types import Cycle, FloatArray, Frames, IntArray


@dataclass(frozen=True, slots=True)
class Part:
    """Consecutive frames of one cycle, or of none.

    `ordinal` counts the cycles opened in this run (0 before the first), `number` is the published
    cycle number (0 = between cycles), `opens` says that the first frame opens the cycle.
    """

    frames: Frames
    ordinal: int
    number: int
    opens: bool


def join_parts(parts: Iterable[Part]) -> list[Part]:
    """Return the same samples in as few parts as can be; samples may come singly."""
    groups: list[list[Part]] = []
    for part in parts:
        if groups and _goes_on(groups[-1][-1], part):
            groups[-1].append(part)
        else:
            groups.append([part])
    return [
        replace(group[0], frames=join_frames([p.frames for p in group]))
        if len(group) > 1
        else group[0]
        for group in groups
    ]


def _goes_on(last: Part, part: Part) -> bool:
    """Return whether a part follows in the same cycle, on a clock that was not set back."""
    same = (part.ordinal, part.number) == (last.ordinal, last.number) and not part.opens
    return same and part.frames.stamp_ns[0] > last.frames.stamp_ns[-1]


@dataclass(frozen=True, slots=True)
class Announced:
    """The last cycle that was announced, whether it was stored or not.

    Attributes
    ----------
    number : int
        Its number, 0 = none.
    start_ns : int
        Its first stamp [ns].
    """

    number: int = 0
    start_ns: int = 0


@dataclass(frozen=True, slots=True)
class Resume:
    """Where a valve's cycles go on after a restart.

    Attributes
    ----------
    start_ns, end_ns : int
        First and last stamp of the last stored cycle [ns]; the last before the first =
        none is stored.
    announced : Announced
        Its number is not given to a cycle that begins later, even if it was never stored.
    """

    start_ns: int = 0
    end_ns: int = -(10**18)
    announced: Announced = Announced()


@dataclass(frozen=True, slots=True)
class TrackState:
    """Samples of one signal that may still be needed, and what is known of those before.

    Attributes
    ----------
    name : str
        Of the signal.
    stamp_ns : (N,) int64 array
        Stamps of the samples that wait [ns].
    values : (N,) array
        Their values [unit of the signal].
    last_ns : int or None
        Newest stamp [ns].
    held_value : float
        Last value that was used, NaN before the first [unit of the signal].
    older_ns : tuple of int
        Stamps that may confirm that the clock was set back [ns].
    counts : (received, duplicate, late, bad)
        As `SignalCounts`.
    """

    name: str
    stamp_ns: IntArray
    values: FloatArray
    last_ns: int | None
    held_value: float
    older_ns: tuple[int, ...]
    counts: tuple[int, int, int, int]


@dataclass(frozen=True, slots=True)
class AlignerState:
    """All that an aligner knows beside its configuration.

    Attributes
    ----------
    tracks : tuple of TrackState
        One a signal.
    released_ns : int or None
        Stamp of the last frame that was released [ns].
    jumps : int
        Times the clock was set back [1].
    late : tuple of str
        Signals of which samples came after their frame, and nobody was told yet.
    """

    tracks: tuple[TrackState, ...]
    released_ns: int | None
    jumps: int
    late: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class SegmenterState:
    """All that a segmenter knows beside its configuration.

    Attributes
    ----------
    rule : RuleState
        What the rule remembers.
    frames : Frames or None
        The running cycle so far.
    number, missed : int
        Of the running cycle, number 0 = between cycles; cycles missed before it, -1 = unknown.
    reproducible : bool
        Whether the running cycle lost and guessed nothing.
    late, late_ahead : str
        Signals that came too late to cut the running cycle, or the one that the next frames open.
    last_number, missed_before, counted_before : int
        Last number given; cycles missed since; what is added to a counter that began again.
    ordinal : int
        Cycles opened in this run.
    lengths : tuple of int
        Samples of the last closed cycles.
    resume : Resume or None
        What is known of the cycles before a restart, until one opens.
    first_ns, begin_ns : int or None
        First stamp of the stream [ns]; the second counts anew where the clock is set back.
    inside, goes_on : bool
        Whether the stream is inside the last stored cycle, or follows it without a gap.
    """

    rule: RuleState
    frames: Frames | None
    number: int
    missed: int
    reproducible: bool
    late: str
    late_ahead: str
    last_number: int
    missed_before: int
    counted_before: int
    ordinal: int
    lengths: tuple[int, ...]
    resume: Resume | None
    first_ns: int | None
    begin_ns: int | None
    inside: bool
    goes_on: bool


@dataclass(frozen=True, slots=True)
class TwinState:
    """All that a twin knows beside its configuration and its model.

    Attributes
    ----------
    aligner, segmenter : AlignerState, SegmenterState
        Of its parts.
    memory_after : tuple of (int, Memory)
        What was learnt after which cycles of this run, by ordinal.
    done, ordinal : int
        Ordinals of the last cycle whose estimation is done, and of the newest.
    jobs : tuple of (int, Cycle or None)
        Estimations to run, by ordinal, the one that ran first; None = the cycle was dropped.
    waiting : tuple of Part
        Samples that wait for the estimate of their cycle.
    early : tuple of int
        Ordinals of the cycles that did not wait for their estimate.
    in_force : InForce or None
        The model that predicts.
    predictor : (S,) array
        State of the model's prediction.
    last_ns : int or None
        Stamp of the last predicted sample [ns].
    """

    aligner: AlignerState
    segmenter: SegmenterState
    memory_after: tuple[tuple[int, Memory], ...]
    done: int
    ordinal: int
    jobs: tuple[tuple[int, Cycle | None], ...]
    waiting: tuple[Part, ...]
    early: tuple[int, ...]
    in_force: InForce | None
    predictor: FloatArray
    last_ns: int | None
