# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Samples of stored cycles out of the bags that recorded them: a history keeps none."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.types import Prediction, Validity
from valve_twin.io.bags.contents import bag_info
from valve_twin.io.bags.signals import read_columns
from valve_twin.io.cdr.signals import SignalSource
from valve_twin.io.errors import ValveTwinError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.types import FloatArray, IntArray
    from valve_twin.io.history.tables import CycleRecord

MOST_BYTES = 500_000_000
"""A larger bag is not read for a page [B]."""

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


class Samples:
    """The bags of a plant; safe from any thread. What was read last is kept.

    Parameters
    ----------
    bags : sequence of str
        Folders or files, as `bag_recorder` wrote them with the topics of a twin.
    """

    def __init__(self, bags: Sequence[str]) -> None:
        self._bags = tuple(bags)
        self._lock = threading.Lock()
        self._kept: dict[tuple[str, str, int], _Read] = {}

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
                with self._lock:
                    read = self._read(bag, valve)
            except ValveTwinError as err:
                why = str(err)
                continue
            inside = slice(*np.searchsorted(read.stamp_ns, [record.start_ns, record.end_ns + 1]))
            if inside.stop - inside.start > 1:
                return _prediction(record.cycle, read, inside)
            why = why or f"{bag}: holds no sample of cycle {record.cycle} of {valve}"
        raise NoSamplesError(why)

    def _read(self, bag: str, valve: str) -> _Read:
        info = bag_info(bag)
        key = bag, valve, info.message_count
        found = self._kept.get(key)
        if found is None:
            if info.size > MOST_BYTES:
                msg = (
                    f"{bag}: has {info.size / 1e6:.0f} MB, {MOST_BYTES / 1e6:.0f} MB at most are "
                    "read for a page: cut the time wanted out of it by valve-twin cut"
                )
                raise NoSamplesError(msg)
            self._kept.clear()  # one at a time: a bag may fill much of the memory
            topic = f"{valve}/twin/prediction"
            types = {t.name: t.type for t in info.topics}
            found = self._kept[key] = _read(bag, topic, types.get(topic, _SINGLE))
        return found


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
