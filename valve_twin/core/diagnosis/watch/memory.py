# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What was found in the features of one valve before, so that only new cycles are judged.

A memory changes no result: what is taken from it was found in the same values, which are
compared, or in the first of them, by steps that each row takes once. Without one all is found
anew, to the same bits.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from valve_twin.core.diagnosis.changes import beyond, slips
from valve_twin.core.diagnosis.direct.noise import Noise
from valve_twin.core.diagnosis.features import NOISE
from valve_twin.core.diagnosis.generic.features import MOVE_NOISE
from valve_twin.core.diagnosis.generic.reference import has_noise_of_rest
from valve_twin.core.diagnosis.watch.alarm import Seen
from valve_twin.core.diagnosis.watch.growing import Growing, begins
from valve_twin.core.diagnosis.watch.straight import follow
from valve_twin.core.estimation.data.one_thread import rows_times

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from valve_twin.core.diagnosis.changes.finding import Finding
    from valve_twin.core.diagnosis.config import DetectionConfig
    from valve_twin.core.diagnosis.features import FeatureSet
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.past.columns import Columns, Rows
    from valve_twin.core.types import FloatArray, IntArray

Found: TypeAlias = "tuple[list[Finding], bool, float]"
"""Faults, whether one could be found, and by how far the newest cycle departs."""


class Record(NamedTuple):
    """Cycles of one product between two maintenance events, and how they are judged."""

    cycles: IntArray
    vectors: FloatArray
    table: SignatureTable
    config: DetectionConfig
    start: int

    def same(self, other: Record) -> bool:
        """Return whether another is this one."""
        rules = self.table is other.table and self.start == other.start
        if not rules or len(self.cycles) != len(other.cycles) or self.config != other.config:
            return False
        return begins(self.cycles, other.cycles) and begins(self.vectors, other.vectors)


class Part:
    """What was found in one record."""

    def __init__(self) -> None:
        self._seen: list[Seen] = []
        self._record: Record | None = None
        self._found: Found = ([], False, 0.0)

    def found(self, record: Record, search: Callable[[Record, Part], Found]) -> Found:
        """Return what is found in a record; sought where it is not the last one.

        Parameters
        ----------
        record : Record
            The record.
        search : callable
            Seeks in it.
        """
        if self._record and not begins(self._record.cycles, record.cycles):
            self._seen = []  # the numbers of cycles stand in what was found
        if self._record is None or not self._record.same(record):
            self._found = search(record, self)
            self._record = record
        return self._found

    def seen(
        self,
        number: int,
        vectors: FloatArray,
        table: SignatureTable,
        config: DetectionConfig,
        start: int,
    ) -> Seen:
        """Return the first alarm of the record without the faults found before.

        Parameters
        ----------
        number : int
            How many these are.
        vectors : (N, F) array
            Features that are left [unit by feature].
        table : SignatureTable
            Signatures of the valve's faults.
        config : DetectionConfig
            When to speak.
        start : int
            First row that may raise an alarm.
        """
        if number < len(self._seen) and self._seen[number].begins(vectors, table, config, start):
            self._seen[number].grow(vectors)
        else:
            self._seen[number:] = [Seen(vectors, table, config, start)]
        return self._seen[number]


class Memory:
    """Of one product: its records, by their first row, and its features without slips."""

    def __init__(self) -> None:
        self._parts: dict[int, Part] = {}
        self.slips = slips.Slips()

    def of(self, first: int) -> Part:
        """Return what was found in the record that begins with a row."""
        return self._parts.setdefault(first, Part())

    def keep(self, first: Sequence[int]) -> None:
        """Let go of all records but those that begin with some rows."""
        self._parts = {row: part for row, part in self._parts.items() if row in first}


class Known:
    """Of one valve: its features as they are followed, and what was found by product."""

    def __init__(self) -> None:
        self._kind: FeatureSet | None = None
        self._columns: list[Columns | None] = []
        self._vectors = Growing(0)
        self._products: dict[int, Memory] = {}
        self._noise: dict[int, Noise] = {}

    def of(self, product: int) -> Memory:
        """Return what was found of a product."""
        return self._products.setdefault(product, Memory())

    def noise(self, first: int) -> Noise:
        """Return what was found of the sensor's noise in the record that begins with a row."""
        return self._noise.setdefault(first, Noise())

    def vectors(self, rows: Rows, kind: FeatureSet) -> FloatArray:
        """Return features as they are followed, (N, F); no noise where that was of whole cycles.

        Parameters
        ----------
        rows : Rows
            Features, a cycle a row.
        kind : FeatureSet
            Which.
        """
        named = (*kind.names, MOVE_NOISE)
        columns = [rows.parameters.get(name) for name in named]
        if kind != self._kind or not all(map(_begins, self._columns, columns)):
            self._vectors = Growing(len(kind.names))
        count = len(self._vectors)
        if count < len(rows):
            new = rows.since(count)
            vectors = kind.vectors(new.usable)
            if kind.of_any_valve and NOISE in kind.names:
                vectors[~has_noise_of_rest(new), kind.names.index(NOISE)] = np.nan
            self._vectors.put(count, vectors)
        self._kind, self._columns = kind, columns
        return self._vectors.rows


def _begins(known: Columns | None, now: Columns | None) -> bool:
    """Return whether a parameter's columns are the first rows of others."""
    if known is None or now is None:
        return known is now
    return begins(known.value, now.value) and begins(known.status, now.status)


def warm_up() -> None:
    """Compile every kernel of the search for faults."""
    one, sums = np.zeros((1, 1)), np.zeros((4, 1))  # a line takes two rows before the newest
    rows_times(one, one)
    follow(sums, sums, sums, one, 2, 0, (1, 2, 1.0), one.copy(), one.copy(), one.copy())
    beyond.warm_up()
    slips.warm_up()
