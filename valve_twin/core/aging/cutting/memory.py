# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What was found in the values of one valve before, so that it is not sought again.

A memory changes no result: what is taken from it was found in the same values, which are
compared. Without one everything is found anew.
"""

from __future__ import annotations

import hashlib
from collections import deque
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from valve_twin.core.aging.changepoint import distances
from valve_twin.core.aging.cutting.stretch import (
    Search,
    Stretch,
    extend,
    search,
    searched,
    step_of,
)
from valve_twin.core.aging.trend import Line
from valve_twin.core.diagnosis.watch.memory import Known

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from valve_twin.core.aging.config import AgingConfig
    from valve_twin.core.types import FloatArray

MOST_VALUES = 2**18
"""Values whose searches are remembered [1], 24 bytes each."""

_NEWEST = 16  # results of other kinds, and looks ahead, that are remembered

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class _Known:
    """A search, what it was made of, and how far each value lies off its neighbours."""

    x: FloatArray
    y: FloatArray
    off: FloatArray
    result: Search

    def begins(self, x: FloatArray, y: FloatArray) -> bool:
        """Return whether its values are the first of others."""
        n = len(self.x)
        if n > len(x) or self.y[0] != y[0] or self.y[-1] != y[n - 1]:
            return False
        return np.array_equal(self.y, y[:n]) and np.array_equal(self.x, x[:n])


@dataclass(frozen=True, slots=True)
class _Stored:
    """A search that was stored, and the digest of the values that it was made of."""

    digest: str
    off: FloatArray
    result: Search


def _digest(x: FloatArray, y: FloatArray) -> str:
    return hashlib.blake2b(x.tobytes() + y.tobytes()).hexdigest()


class Memory:
    """Searches of one valve's parameters, the newest `MOST_VALUES` values of them.

    Attributes
    ----------
    due : bool
        Whether a search can be made now that will be wanted soon, see `ahead`.
    faults : Known
        What was found in the features of cycles; it is not stored.
    """

    def __init__(self) -> None:
        self._config: AgingConfig | None = None
        self._known: deque[_Known] = deque()
        self._others: deque[tuple[str, tuple[FloatArray, ...], object]] = deque(maxlen=_NEWEST)
        self._looked: deque[tuple[int, float, float]] = deque(maxlen=_NEWEST)
        self._looks_ahead = False
        self._stored: list[_Stored] = []
        self.due = False
        self.faults = Known()

    def freeze(self) -> tuple[list[dict[str, Any]], list[NDArray[Any]]]:
        """Return what straight pieces were found as values of JSON, and their arrays in order."""
        head, arrays = [], []
        for known in self._known:
            result = known.result
            if np.isfinite(result.found.period):
                continue
            head.append(
                {
                    "digest": _digest(known.x, known.y),
                    "straight": result.straight,
                    "pieces": result.pieces,
                    "line": asdict(result.line) if result.line else None,
                    "power": result.power,
                    "product": result.product,
                }
            )
            arrays += [known.off, result.found.starts, result.found.outlier]
        return head, arrays

    def thaw(self, head: Sequence[Mapping[str, Any]], arrays: Sequence[NDArray[Any]]) -> None:
        """Take over what was frozen: each search is used where its very values come again.

        Parameters
        ----------
        head : sequence of mappings
            What `freeze` returned.
        arrays : sequence of arrays
            Its arrays.
        """
        rest = iter(arrays)
        for one in head:
            off, starts, outlier = next(rest), next(rest), next(rest)
            line = Line(**one["line"]) if one["line"] else None
            found = Stretch(starts, outlier, np.zeros(len(outlier)), float("nan"))
            left = one["power"], one["product"]
            result = Search(found, one["straight"], one["pieces"], line, *left)
            self._stored.append(_Stored(one["digest"], off, result))

    @contextmanager
    def ahead(self) -> Iterator[None]:
        """Search, in an assessment inside, what will be wanted soon: its result is of no use."""
        self._looks_ahead, self.due = True, False
        try:
            yield
        finally:
            self._looks_ahead, self.due = False, False

    def first(self, x: FloatArray, config: AgingConfig) -> int:
        """Return how many of (N,) axis positions have been searched, see `searched`."""
        if config is not self._config and config != self._config:
            self._known.clear()
            self._others.clear()
            if self._config is not None:
                self._stored.clear()
        self._config = config
        count, places = len(x), config.max_candidates
        done = searched(count, places)
        if done == count:
            return count
        soon = count // step_of(count, places) * step_of(count, places)
        if soon <= done:
            return done
        look = (soon, float(x[0]), float(x[soon - 1]))
        if self._looks_ahead:
            if look not in self._looked:
                self._looked.append(look)
            return soon
        self.due = self.due or look not in self._looked
        return done

    def of(self, what: str, arrays: tuple[FloatArray, ...], make: Callable[[], T]) -> T:
        """Return what follows from some arrays alone; made where it is not known.

        Parameters
        ----------
        what : str
            Name of what is made.
        arrays : tuple of arrays
            All that it depends on beside the configuration.
        make : callable
            Makes it.
        """
        for name, known, found in reversed(self._others):
            if name == what and all(map(np.array_equal, known, arrays)):
                return found  # type: ignore[return-value]
        result = make()
        self._others.append((what, arrays, result))
        return result

    def pieces(self, x: FloatArray, y: FloatArray, config: AgingConfig) -> Stretch:
        """Return the pieces of one undisturbed stretch.

        Parameters
        ----------
        x, y : (N,) arrays
            Axis positions [axis unit], strictly increasing, and values [unit].
        config : AgingConfig
            Sizes and penalties.
        """
        done = self.first(x, config)
        if done < len(x):
            found = extend(self._search(x[:done], y[:done], config), x, y, config)
            if found is not None:
                return found
        return self._search(x, y, config).found

    def _search(self, x: FloatArray, y: FloatArray, config: AgingConfig) -> Search:
        earlier = None
        for known in reversed(self._known):
            if (earlier is None or len(known.x) > len(earlier.x)) and known.begins(x, y):
                if len(known.x) == len(x):
                    return known.result
                earlier = known
        stored = self._stored_of(x, y)
        if stored is not None:
            off, result = stored.off, stored.result
        else:
            off = distances(x, y, earlier.off if earlier else None)
            result = search(x, y, off, config)
        if len(x) > config.max_candidates:
            self._known.append(_Known(x, y, off, result))
            while sum(len(k.x) for k in self._known) > MOST_VALUES:
                self._known.popleft()
        return result

    def _stored_of(self, x: FloatArray, y: FloatArray) -> _Stored | None:
        """Return the stored search of these very values, None where there is none."""
        same = [s for s in self._stored if len(s.off) == len(x)]
        digest = _digest(x, y) if same else ""
        return next((s for s in same if s.digest == digest), None)
