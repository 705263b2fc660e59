# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The past of a valve as plain values and arrays, to be stored, and back to the last bit."""

from __future__ import annotations

from dataclasses import asdict, astuple
from typing import TYPE_CHECKING, Any

import numpy as np

from valve_twin.core.diagnosis.detection import Finding
from valve_twin.core.past.columns import Settled, Table
from valve_twin.core.past.state import AgingState
from valve_twin.core.types import Guard

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

LAYOUT = 1
"""Number of this layout: what another one wrote is not read."""


def freeze(state: AgingState) -> tuple[dict[str, Any], list[NDArray[Any]]]:
    """Return what a state holds as values of JSON, and its arrays in their order.

    Parameters
    ----------
    state : AgingState
        It may go on afterwards: the arrays stay as they are.
    """
    arrays: list[NDArray[Any]] = []
    settled = state._settled
    head = {
        "layout": LAYOUT,
        "recent": state._recent,
        "recent_features": state._recent_features,
        "old": state._old,
        "stride": state._stride,
        "look_at": state._look_at,
        "apart": list(state._apart),
        "settled": None if settled is None else asdict(settled),
        "tables": [_freeze_table(t, arrays) for t in (state._trend, state._features)],
    }
    return head, arrays


def thaw(head: Mapping[str, Any], arrays: Sequence[NDArray[Any]]) -> AgingState:
    """Return the state that was frozen.

    Parameters
    ----------
    head : mapping
        What `freeze` returned, of this layout.
    arrays : sequence of arrays
        Its arrays.

    Raises
    ------
    ValueError
        If it is of another layout.
    """
    if head.get("layout") != LAYOUT:
        msg = f"it is of layout {head.get('layout')}, this is {LAYOUT}"
        raise ValueError(msg)
    state = AgingState(head["recent"], head["recent_features"])
    state._old, state._stride = head["old"], head["stride"]
    state._look_at = head["look_at"]
    state._apart = dict.fromkeys(head["apart"])
    settled = head["settled"]
    if settled is not None:
        found = {name: tuple(_finding(f) for f in settled[name]) for name in _FINDINGS}
        state._settled = Settled(**{**settled, **found})
    rest = list(arrays)
    state._trend, state._features = (_thaw_table(t, rest) for t in head["tables"])
    return state


_FINDINGS = ("findings", "direct")


def _finding(values: Mapping[str, Any]) -> Finding:
    return Finding(**{**values, "rivals": tuple(values["rivals"])})


def _freeze_table(table: Table, arrays: list[NDArray[Any]]) -> dict[str, Any]:
    names = list(table._columns)
    arrays += [table._columns[key][: table._size] for key in names]
    return {
        "added": table.added,
        "size": table._size,
        "columns": names,
        "reasons": list(table._reasons.items()),
        "failed": [[key, [astuple(g) for g in guards]] for key, guards in table._failed.items()],
        "models": list(table._models),
    }


def _thaw_table(head: Mapping[str, Any], arrays: list[NDArray[Any]]) -> Table:
    table = Table(added=head["added"])
    table._columns = {(kind, name): arrays.pop(0) for kind, name in head["columns"]}
    table._size = table._room = head["size"]
    table._reasons = {int(key): reason for key, reason in head["reasons"]}
    table._failed = {int(key): tuple(Guard(*g) for g in found) for key, found in head["failed"]}
    table._models = dict.fromkeys(head["models"])
    if any(len(column) != table._size for column in table._columns.values()):
        msg = "its columns differ in length"
        raise ValueError(msg)
    if table._size:
        table.keep(np.arange(table._size))  # with room to grow
    else:
        table._columns.clear()
    return table
