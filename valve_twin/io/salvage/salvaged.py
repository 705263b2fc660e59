# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What was found of a damaged MCAP file."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from valve_twin.io.mcap.reader import Summary
    from valve_twin.io.salvage.chunk import Walk
    from valve_twin.io.salvage.damage import Loss


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
    """

    offset: int
    length: int
    verified: bool
    records: bytes | None
    found: Walk
    size: int
    index: dict[int, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Salvage:
    """What a damaged file still holds.

    Attributes
    ----------
    path : Path
        The file.
    summary : Summary
        Definitions, chunks and counts of what is readable.
    rescued : dict
        Records of those chunks that cannot be read as they stand, by their offset.
    losses : tuple of Loss
        Damaged places in the order of the file.
    unverified : dict
        Messages of those chunks for which no check sum stands, by offset.
    suspects : int
        Unverified messages with values that are no finite number.
    lost : dict or None
        Lost messages by topic, None = unknown.
    lost_count : int or None
        Lost messages, None = unknown.
    """

    path: Path
    summary: Summary
    rescued: dict[int, bytes]
    losses: tuple[Loss, ...]
    unverified: dict[int, int]
    suspects: int
    lost: dict[str, int] | None
    lost_count: int | None

    @property
    def unverified_count(self) -> int:
        """Messages for whose values no check sum stands."""
        return sum(self.unverified.values())
