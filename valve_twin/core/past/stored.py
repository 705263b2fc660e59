# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The past of a valve as plain values and arrays, to be stored, and back to the last bit."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from valve_twin.core.diagnosis.changes.finding import Finding
from valve_twin.core.diagnosis.reference import NotYet
from valve_twin.core.past.columns import Settled
from valve_twin.core.past.state import AgingState

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

LAYOUT = 1
"""Number of this layout: what another one wrote is not read."""

_FINDINGS = ("findings", "direct")


def freeze(state: AgingState) -> tuple[dict[str, Any], list[NDArray[Any]]]:
    """Return what a state holds as values of JSON, and its arrays in their order.

    Parameters
    ----------
    state : AgingState
        It may go on afterwards: the arrays stay as they are.
    """
    arrays: list[NDArray[Any]] = []
    head = state.freeze(arrays)
    settled = head["settled"]
    plain = None if settled is None else asdict(settled)
    yet = settled is not None and isinstance(settled.doubt, NotYet)
    return {**head, "layout": LAYOUT, "settled": plain, "not_yet": yet}, arrays


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
    settled = head["settled"]
    if settled is not None:
        found = {name: tuple(map(_finding, settled[name])) for name in _FINDINGS}
        doubt = settled["doubt"]
        kept = NotYet(doubt) if head.get("not_yet") else doubt
        settled = Settled(**{**settled, **found, "doubt": kept})
    return AgingState.thaw({**head, "settled": settled}, list(arrays))


def _finding(values: Mapping[str, Any]) -> Finding:
    return Finding(**{**values, "rivals": tuple(values["rivals"])})
