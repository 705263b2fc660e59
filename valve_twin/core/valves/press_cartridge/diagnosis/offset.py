# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What an offset of the command does to the features, from what a dead band does."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

from valve_twin.core.diagnosis.table import Signature

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.table import SignatureTable


@cache
def with_command_offset(table: SignatureTable) -> SignatureTable:
    """Return a table that knows an offset of the command, too.

    A command that arrives smaller is a dead band grown by as much. One that arrives larger is a
    dead band that has shrunk, whose changes are those of a grown one with the other sign (to
    first order in its share of the command).

    Parameters
    ----------
    table : SignatureTable
        With signatures of `dead_band`.

    Returns
    -------
    SignatureTable
        The same and a positive `command_offset` of the same sizes.
    """
    larger = tuple(
        Signature("command_offset", s.severity, tuple(-c for c in s.change), s.scatter)
        for s in table.signatures
        if s.fault == "dead_band"
    )
    return replace(table, signatures=(*table.signatures, *larger))
