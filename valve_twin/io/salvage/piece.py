# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""One part of a damaged file that holds messages."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from valve_twin.io.mcap.damage import Loss
    from valve_twin.io.mcap.format import ChunkIndex
    from valve_twin.io.salvage.chunk import ChunkHead
    from valve_twin.io.salvage.walk import Walk


@dataclass(slots=True)
class Piece:
    """A chunk that was found, or messages outside chunks.

    Attributes
    ----------
    offset, length : int
        Where it lies in the file [B].
    verified : bool
        Whether a check sum stands for it.
    records : bytes or None
        Its records; None where any reader reads them out of the file.
    found : Walk
        What is in it.
    size : int
        Bytes of its records [B].
    index : dict
        Where its message indexes lie, by channel.
    head, hint : ChunkHead, ChunkIndex or None
        What the likeliest reading of its head says, and what the summary says.
    loss : Loss or None
        What is lost of it, where that was not counted yet.
    """

    offset: int
    length: int
    verified: bool
    records: bytes | None
    found: Walk
    size: int
    index: dict[int, int] = field(default_factory=dict)
    head: ChunkHead | None = None
    hint: ChunkIndex | None = None
    loss: Loss | None = None

    @property
    def claimed(self) -> tuple[int | None, int | None]:
        """First and last log time by the summary, else by its head [ns]; None = not believed."""
        stated = self.hint or self.head
        if stated is None or (stated is self.head and stated.start_ns > stated.end_ns):
            return None, None
        return stated.start_ns, stated.end_ns

    @property
    def span(self) -> tuple[int, int] | None:
        """The wider of the spans that head and summary claim, unverified [ns]."""
        stated = [t for t in (self.head, self.hint) if t is not None]
        if not stated:
            return None
        return min(t.start_ns for t in stated), max(t.end_ns for t in stated)
