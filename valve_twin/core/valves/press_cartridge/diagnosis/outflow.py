# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What weaker emptying pilots do to the features, from what a weaker filling coil does."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

from valve_twin.core.diagnosis.table import Signature

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.table import SignatureTable

WEAK_OUTFLOW = "weak_outflow"
"""Name of the fault."""

_OTHER_WAY = {
    "gain_out_low": "gain_in_low",
    "gain_out_high": "gain_in_high",
    "delay_out": "delay_in",
    "shortfall": "shortfall",
}
"""Features that it changes, and those that a filling coil changes alike."""


@cache
def with_weak_outflow(table: SignatureTable) -> SignatureTable:
    """Return a table that knows emptying pilots which deliver less, too.

    Both directions are alike: an emptying command that acts as if divided by a number lowers the
    gains of emptying by as much as a filling coil lowers those of filling (to first order).

    Parameters
    ----------
    table : SignatureTable
        With signatures of `coil_resistance`.

    Returns
    -------
    SignatureTable
        The same and `weak_outflow` of the same sizes.
    """
    weaker = tuple(
        Signature(
            WEAK_OUTFLOW, s.severity, _other_way(table, s.change), _other_way(table, s.scatter)
        )
        for s in table.signatures
        if s.fault == "coil_resistance"
    )
    return replace(table, signatures=(*table.signatures, *weaker))


def _other_way(table: SignatureTable, values: tuple[float, ...]) -> tuple[float, ...]:
    """Return by feature what the one of the other direction has."""
    known = dict(zip(table.features, values, strict=True))
    return tuple(known[_OTHER_WAY[n]] if n in _OTHER_WAY else 0.0 for n in table.features)
