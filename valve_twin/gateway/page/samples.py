# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Samples of stored cycles out of the bags that recorded them: a history keeps none."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.types import Prediction, Validity
from valve_twin.io.bags.contents import bag_info
from valve_twin.io.bags.signals import read_columns
from valve_twin.io.cdr.signals import SignalSource
from valve_twin.io.errors import ValveTwinError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from valve_twin.core.types import FloatArray, IntArray
    from valve_twin.io.bags.contents import BagInfo
    from valve_twin.io.history.tables import CycleRecord

MOST_BYTES = 500_000_000
"""A larger bag is not read for a page [B]."""

MOST_KEPT_BYTES = 200_000_000
"""Of what was read so much is kept beside what was read last [B]."""

REFRESH_S, REST = 5.0, 4.0
"""A bag is looked at again at most so often, and so many times what the last look took later: one
that is still being recorded is not read at every view [s, 1]."""

WAIT_S = 2.0
"""Who wants samples while others have a bag read waits so long [s]."""

_FIELDS = ("measured", "predicted", "simulated", "residual", "validity")
_SINGLE = "valve_twin_msgs/msg/Prediction"
_SERIES = "valve_twin_msgs/msg/PredictionSeries"


class NoSamplesError(ValveTwinError):
    """The samples of a cycle are not there; the text says why."""


@dataclass(frozen=True, slots=True)
class _Read:
    """The predictions of a valve in a bag, by stamp."""

    stamp_ns: IntArray
    columns: Mapping[str, FloatArray]

    @property
    def size(self) -> int:
        """What it takes of the memory [B]."""
        return self.stamp_ns.nbytes + sum(c.nbytes for c in self.columns.values())

    def covers(self, record: CycleRecord) -> bool:
        """Return whether what came later cannot belong to a cycle."""
        return bool(len(self.stamp_ns)) and record.end_ns < int(self.stamp_ns[-1])


@dataclass(slots=True)
class _Kept:
    """What was read, of which bag as it was then, and when it is to be looked at again [s]."""

    read: _Read
    start_ns: int
    size: int
    due_s: float

    def holds(self, info: BagInfo, record: CycleRecord) -> bool:
        """Return whether a bag has nothing else of a cycle than what was read."""
        if info.start_ns != self.start_ns or info.size < self.size:
            return False
        return info.size == self.size or self.read.covers(record)


class Samples:
    """The bags of a plant; safe from any thread. What was read last is kept.

    Parameters
    ----------
    bags : sequence of str
        Folders or files, as `bag_recorder` wrote them with the topics of a twin.
    clock : callable
        Returns a time that only goes on [s].
    """

    def __init__(self, bags: Sequence[str], clock: Callable[[], float] = time.monotonic) -> None:
        self._bags, self._clock = tuple(bags), clock
        self._lock = threading.Lock()
        self._kept: dict[tuple[str, str], _Kept] = {}

    def cycle(self, valve: str, record: CycleRecord) -> Prediction:
        """Return the samples of a cycle.

        Parameters
        ----------
        valve : str
            Name of the valve.
        record : CycleRecord
            The stored cycle: its stamps say which samples are its own.

        Raises
        ------
        NoSamplesError
            If no bag is named or none holds them.
        """
        if not self._bags:
            msg = "a history keeps no samples: name the bag that recorded them by --bag"
            raise NoSamplesError(msg)
        why = ""
        for bag in self._bags:
            try:
                read = self._read(bag, valve, record)
            except ValveTwinError as err:
                why = str(err)
                continue
            inside = slice(*np.searchsorted(read.stamp_ns, [record.start_ns, record.end_ns + 1]))
            if inside.stop - inside.start > 1:
                return _prediction(record.cycle, read, inside)
            why = why or f"{bag}: holds no sample of cycle {record.cycle} of {valve}"
        raise NoSamplesError(why)

    def _read(self, bag: str, valve: str, record: CycleRecord) -> _Read:
        if not self._lock.acquire(timeout=WAIT_S):
            msg = f"{bag}: bags are being read for others: load the page again in a while"
            raise NoSamplesError(msg)
        try:
            return self._read_alone(bag, valve, record)
        finally:
            self._lock.release()

    def _read_alone(self, bag: str, valve: str, record: CycleRecord) -> _Read:
        kept, begun_s = self._kept.pop((bag, valve), None), self._clock()
        if kept is None or begun_s >= kept.due_s:
            info = bag_info(bag)
            if kept is None or not kept.holds(info, record):
                kept = _Kept(_read_checked(bag, valve, info), info.start_ns, info.size, 0.0)
            end_s = self._clock()
            kept.due_s = end_s + max(REFRESH_S, REST * (end_s - begun_s))
        while self._kept and sum(k.read.size for k in self._kept.values()) > MOST_KEPT_BYTES:
            del self._kept[next(iter(self._kept))]
        self._kept[bag, valve] = kept
        return kept.read


def _read_checked(bag: str, valve: str, info: BagInfo) -> _Read:
    if info.size > MOST_BYTES:
        msg = (
            f"{bag}: has {info.size / 1e6:.0f} MB, {MOST_BYTES / 1e6:.0f} MB at most are "
            "read for a page: cut the time wanted out of it by valve-twin cut"
        )
        raise NoSamplesError(msg)
    topic = f"{valve}/twin/prediction"
    types = {t.name: t.type for t in info.topics}
    return _read(bag, topic, types.get(topic, _SINGLE))


def _read(bag: str, topic: str, kind: str) -> _Read:
    end = "[]" if kind == _SERIES else ""
    sources = [SignalSource(name, topic, kind, name + end) for name in _FIELDS]
    sources.append(SignalSource("sigma", topic, kind, "residual_sigma"))
    read = read_columns(bag, sources)
    order = np.argsort(read[0].stamp_ns, kind="stable")
    stamp_ns = read[0].stamp_ns[order]
    columns = {c.signal: r.values[order] for c, r in zip(sources[:-1], read, strict=False)}
    sigma = read[-1]
    place = np.searchsorted(sigma.stamp_ns, stamp_ns, side="right") - 1
    columns["sigma"] = sigma.values[np.maximum(place, 0)]
    return _Read(stamp_ns, columns)


def _prediction(cycle: int, read: _Read, inside: slice) -> Prediction:
    cut = {name: values[inside] for name, values in read.columns.items()}
    known = cut["sigma"][np.isfinite(cut["sigma"])]
    validity = np.nan_to_num(cut["validity"], nan=float(Validity.BAD_INPUT))
    return Prediction(
        cycle=cycle,
        stamp_ns=read.stamp_ns[inside],
        measured=cut["measured"],
        predicted=cut["predicted"],
        simulated=cut["simulated"],
        residual=cut["residual"],
        residual_sigma=float(np.median(known)) if len(known) else np.nan,
        validity=validity.astype(np.uint8),
    )
