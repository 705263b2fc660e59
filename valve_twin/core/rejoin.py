# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""After a restart: whether the stream goes on where a snapshot of the twin ends.

It does where no signal lacks a sample in between, be it that the data waited or that it is given
again; what the snapshot holds is left out then. Else samples are missing inside the cycle that
was running, which is not taken in part for a whole one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.alignment import POSITION
from valve_twin.core.gaps import gap_ns
from valve_twin.core.types import CONDITIONS, FloatArray, IntArray

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.state import TwinState

_EVER = 2**62

Samples = tuple[str, IntArray, FloatArray]
"""Name of a signal, its stamps [ns] and its values."""


class Rejoin:
    """Keeps the samples after a restart until it is known whether the stream goes on.

    Parameters
    ----------
    state : TwinState
        The snapshot.
    period_s : float
        Nominal sampling time of the position [s].
    hold_back_s : float
        How long a signal that is silent is waited for, on the data's clock [s].
    since_ns, closed_ns : int
        Data that begins before the first is not that of the snapshot given again; the last closed
        cycle begins at the second [ns].

    Attributes
    ----------
    goes_on : bool or None
        Whether the stream goes on; None while that is not known.
    is_sure : bool
        Whether no signal can lack a sample; one that comes seldom may.
    """

    def __init__(
        self,
        state: TwinState,
        period_s: float,
        hold_back_s: float,
        *,
        since_ns: int,
        closed_ns: int,
    ) -> None:
        tracks = state.aligner.tracks
        self._position = tracks[POSITION].name
        self._last = {t.name: t.last_ns for t in tracks if t.last_ns is not None}
        often = max(tracks[POSITION].counts[0], 1)
        self._period_gap_ns = gap_ns(period_s)
        self._gap_ns = {
            t.name: self._period_gap_ns * max(often / max(t.counts[0], 1), 1.0)
            for t in tracks
            if t.name not in CONDITIONS
        }
        self._hold_back_ns = round(hold_back_s * 1e9)
        self._since_ns, self._closed_ns, self._is_other = since_ns, closed_ns, False
        self._first: dict[str, int] = {}
        self._newest_ns = 0
        self._rounds: list[Sequence[Samples]] = []
        self.goes_on: bool | None = None if self._position in self._last else False
        self.is_sure = True

    def add(self, parts: Sequence[Samples]) -> None:
        """Take the next samples of all signals."""
        self._rounds.append(parts)
        for name, stamp_ns, _ in parts:
            if len(stamp_ns):
                self._look(name, stamp_ns)
        if self.goes_on is None:
            self._decide()

    def rounds(self) -> list[list[Samples]]:
        """Return what came and is not known: beyond the snapshot, or beyond its closed cycles.

        Where the stream begins anew, that is for the position to tell.
        """
        if self._is_other:
            return [list(parts) for parts in self._rounds]
        return [[self._new(*samples) for samples in parts] for parts in self._rounds]

    def give_up(self) -> None:
        """Let the stream begin anew, whatever comes."""
        self.goes_on = False

    def _look(self, name: str, stamp_ns: IntArray) -> None:
        self._newest_ns = max(self._newest_ns, int(stamp_ns.max()))
        if name == self._position and int(stamp_ns.min()) < self._since_ns:
            self.goes_on, self._is_other = False, True
        last_ns = self._last.get(name)
        if last_ns is None or name in self._first:
            return
        beyond = stamp_ns[stamp_ns > last_ns]
        if len(beyond):
            self._first[name] = int(beyond[0])
            self._judge(name, int(beyond[0]) - last_ns)

    def _judge(self, name: str, step_ns: int) -> None:
        """Judge the step from the last sample of a signal to the one that follows."""
        if step_ns > self._gap_ns.get(name, np.inf):
            self.goes_on = False
        elif name in self._gap_ns and step_ns > self._period_gap_ns:
            self.is_sure = False

    def _decide(self) -> None:
        silent = [n for n in self._last if n in self._gap_ns and n not in self._first]
        begin_ns = self._first.get(self._position, self._last[self._position])
        if silent and self._newest_ns - begin_ns < self._hold_back_ns:
            return
        for name in silent:
            self._judge(name, self._newest_ns - self._last[name])
        if self.goes_on is None:
            self.goes_on = True

    def _new(self, name: str, stamp_ns: IntArray, values: FloatArray) -> Samples:
        if self.goes_on:
            known_ns = self._last.get(name, -_EVER)
        else:  # the others still hold, however old: the next sample of a command may be far away
            known_ns = self._closed_ns - 1 if name == self._position else -_EVER
        new = stamp_ns > known_ns
        return name, stamp_ns[new], values[new]
