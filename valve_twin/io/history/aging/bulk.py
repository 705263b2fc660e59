# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Rows of estimates into what is known of a valve, a page at a time: columns, no objects.

A first reading of a long history is nothing else. What `row_estimate` and `AgingState.add` make of
the rows one by one is made here of most of them at once, to the same bits; a row that is unlike
the others, or that cannot be read so, goes that way.
"""

from __future__ import annotations

import json
import re
from functools import lru_cache
from operator import itemgetter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from valve_twin.core.diagnosis.features import ESTIMATOR as FEATURES
from valve_twin.core.diagnosis.features import MOTION
from valve_twin.core.past.block import Block
from valve_twin.core.refusal import RefusalCode
from valve_twin.core.types import EstimateStatus, ParameterStatus
from valve_twin.io.history.tables import NOT_FINITE, decode_guards, number_of, row_estimate

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from valve_twin.core.past.state import AgingState
    from valve_twin.core.types import Estimate, FloatArray

AT_ONCE = 250
"""Rows whose texts are read at once [1]: what they are made of does not grow old."""

_NUMBERS = 4  # of a parameter: value, standard error, limits
_STATUS = frozenset(map(int, EstimateStatus))
_STATES = frozenset(map(int, ParameterStatus))
_INTEGERS = itemgetter("cycle", "start_ns", "end_ns", "missed_cycles", "status")
_VALUES = ',"values":[['  # in no name or reason: quotes in those have a stroke before them
_PLAIN = re.compile(r"[0-9+\-.e,naif]*")  # what numbers are written with
_IMPLAUSIBLE = RefusalCode.IMPLAUSIBLE.value


def add_rows(
    state: AgingState,
    rows: Sequence[Mapping[str, Any]],
    read: Callable[[Mapping[str, Any]], Estimate] = row_estimate,
) -> None:
    """Add the estimates of rows of table `estimate` to what is known, in their order.

    Parameters
    ----------
    state : AgingState
        Gets them.
    rows : sequence of mapping
        Rows whose check sums are right.
    read : callable
        Reads one row that goes alone.
    """
    for first in range(0, len(rows), AT_ONCE):
        for found in _runs(rows[first : first + AT_ONCE]):
            block = _block(found) if isinstance(found, list) else None
            if block is not None:
                state.extend(block)
                continue
            alone = [r.row for r in found] if isinstance(found, list) else [found]
            for row in alone:
                state.add(read(row))


class _Head(NamedTuple):
    """What stands before the numbers in the text of parameters: equal in most rows."""

    names: tuple[str, ...]
    states: tuple[int, ...]


class _Row(NamedTuple):
    """A row with its texts read, but for the numbers of its parameters."""

    kind: tuple[str, bool, tuple[str, ...], tuple[str, ...]]
    row: Mapping[str, Any]
    states: tuple[int, ...]
    numbers: str
    conditions: Sequence[Any]
    guards: Sequence[Any]


def _runs(rows: Sequence[Mapping[str, Any]]) -> Iterator[list[_Row] | Mapping[str, Any]]:
    """Yield lists of rows of one kind, and rows that go alone.

    Those of the trend and features take turns in a history and go to tables of their own, so that
    a list of each grows at a time. What features of a cycle tell may rest on what came before: a
    list of features ends behind one of the trend.
    """
    held: dict[bool, list[_Row]] = {False: [], True: []}  # of the trend, features
    for row in rows:
        read = _read(row)
        if read is None:
            yield from filter(None, (held[False], held[True]))
            held = {False: [], True: []}
            yield row
            continue
        of = read.kind[1]
        if held[of] and held[of][0].kind != read.kind:
            yield held[of]
            held[of] = []
        held[of].append(read)
    yield from filter(None, (held[False], held[True]))


def _read(row: Mapping[str, Any]) -> _Row | None:
    """Return a row with its texts read; None where it goes alone."""
    of_features, text = row["estimator"] == FEATURES, row["parameters"]
    if of_features == row["used_by_trend"] or row["reason_code"] == _IMPLAUSIBLE:
        return None
    begin, between, numbers = text.partition(_VALUES)
    head = _head(begin) if between and numbers.endswith("]]}") else None
    if head is None or row["status"] not in _STATUS:
        return None
    numbers, size = numbers[:-3], len(head.names)
    if numbers.count("],[") != size - 1 or numbers.count(",") != _NUMBERS * size - 1:
        return None
    conditions: Sequence[Any] = ()
    guards: Sequence[Any] = ()
    if row["findings"]:
        found = json.loads(row["findings"])
        conditions, guards = found.get("conditions", ()), found.get("guards", ())
    under = tuple(name for name, _ in conditions)
    if len(set(under)) < len(under):
        return None
    kind = (row["model"], of_features, head.names, under)
    return _Row(kind, row, head.states, numbers, conditions, guards)


@lru_cache(maxsize=1000)
def _head(text: str) -> _Head | None:
    """Return the head of a text of parameters; None where its row goes alone."""
    try:
        names, states, reasons = itemgetter("names", "status", "reasons")(json.loads(text + "}"))
        plain = len(set(names)) == len(names) == len(states) == len(reasons) > 0
        plain = plain and set(map(type, names)) == {str} and _STATES.issuperset(states)
    except (ValueError, LookupError, TypeError):
        return None
    if not plain or names[-1].startswith(MOTION):
        return None
    return _Head(tuple(names), tuple(states))


def _numbers(rows: list[_Row]) -> FloatArray | None:
    """Return the (N, P, 4) numbers of the parameters; None where one of them is none."""
    text = ",".join([r.numbers for r in rows]).replace("],[", ",")
    if '"' in text:
        for word in NOT_FINITE:
            text = text.replace(word, word[1:-1])
    if _PLAIN.fullmatch(text) is None:
        return None
    size = len(rows) * len(rows[0].states) * _NUMBERS
    try:
        numbers = np.fromstring(text, dtype=np.float64, sep=",")
    except (ValueError, DeprecationWarning):
        return None
    return numbers.reshape(len(rows), -1, _NUMBERS) if numbers.size == size else None


def _block(rows: list[_Row]) -> Block | None:
    """Return rows of one kind as columns; None where a number of theirs is none."""
    numbers = _numbers(rows)
    if numbers is None:
        return None
    model, of_features, names, conditions = rows[0].kind
    integers = np.array([_INTEGERS(r.row) for r in rows], dtype=np.int64).T
    cycle, start_ns, end_ns, missed, status = integers
    error = [r.row["mse_test"] for r in rows]
    under = [[number_of(x) for _, x in r.conditions] for r in rows]
    return Block(
        model,
        not of_features,
        names,
        conditions,
        cycle,
        start_ns,
        end_ns,
        missed,
        status.astype(np.int8),
        error=np.array([np.nan if e is None else e for e in error], dtype=np.float64),
        states=np.array([r.states for r in rows], dtype=np.int8),
        numbers=numbers,
        under=np.array(under, dtype=np.float64).reshape(len(rows), len(conditions)),
        reasons={k: r.row["reason"] for k, r in enumerate(rows) if _is_refused(r)},
        failed={
            k: tuple(g for g in decode_guards(r.guards) if not g.passed)
            for k, r in enumerate(rows)
            if not all(passed for _, passed, *_ in r.guards)
        },
    )


def _is_refused(row: _Row) -> bool:
    return bool(row.row["status"] == EstimateStatus.REFUSED)
