# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which definitions of a damaged file are believed; what is lost is looked for in its bag."""

from __future__ import annotations

import mmap
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from valve_twin.io.salvage.tail import Trust, read_tail

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from mcap.records import Channel, Schema

    from valve_twin.io.mcap.summary import Summary
    from valve_twin.io.salvage.tail import Tail


@dataclass(slots=True)
class Definitions:
    """Topics and types of a file.

    Attributes
    ----------
    copies : dict
        Copies of each schema by number that differ, the best first.
    channels : dict
        Topics by number.
    notes : list of (str, str)
        What is to be said of them: which and why.
    """

    copies: dict[int, list[Schema]] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    notes: list[tuple[str, str]] = field(default_factory=list)

    @classmethod
    def of(
        cls, tail: Tail, verified: Sequence[Summary], outside: Summary, other: Sequence[Summary]
    ) -> Definitions:
        """Gather all copies; what is verified wins, the data section over the summary.

        Parameters
        ----------
        tail : Tail
            The end of the file.
        verified, other : sequence of Summary
            What stands in chunks with a right check sum, and in others.
        outside : Summary
            What stands outside chunks.
        """
        found = cls()
        sound = tail.trust is Trust.VERIFIED
        first, last = ([tail.summary], []) if sound else ([], [tail.summary])
        topics: dict[int, list[Channel]] = {}
        for source in (*verified, *first, outside, *last, *other):
            for i, schema in source.schemas.items():
                copies = found.copies.setdefault(i, [])
                if schema not in copies:
                    copies.append(schema)
            for i, channel in source.channels.items():
                topics.setdefault(i, []).append(channel)
        # the data is the truth, its first word counts
        for source in (*first, *reversed(verified)):
            found.channels |= source.channels
        for schemas in found.copies.values():
            if len(schemas) > 1:
                why = f"{len(schemas)} copies of '{schemas[0].name}' differ: the first is used"
                found.notes.append(("type", why))
        for i, copied in topics.items():
            used = found.channels.setdefault(i, found.likeliest(copied))
            for channel in copied:
                note = "topic", f"its copies differ: '{used.topic}' is used, not '{channel.topic}'"
                if channel != used and note not in found.notes:
                    found.notes.append(note)
        return found

    def likeliest(self, copies: list[Channel]) -> Channel:
        """Return of copies of a topic that with a known type, and of these the most frequent."""
        return max(copies, key=lambda c: (c.schema_id in self.copies, copies.count(c)))

    def adopt(self, path: Path, held: set[int]) -> None:
        """Take what is missing of topics that hold messages from other files of the bag."""
        found, schemas = self._beside(path, held - set(self.channels))
        for i, channel in found.items():
            number = channel.schema_id
            # a number that stands for another schema here must not be mistaken
            if schemas[number] not in self.copies.setdefault(number, [schemas[number]]):
                continue
            self.channels[i] = channel
            why = "its definition is lost; that of another file of the bag is used"
            self.notes.append((f"topic '{channel.topic}'", why))

    def _beside(
        self, path: Path, wanted: set[int]
    ) -> tuple[dict[int, Channel], dict[int, Schema]]:
        """Return topics and schemas from a sound file that numbers all known topics alike."""
        for other in sorted(path.parent.glob("*.mcap")) if wanted else ():
            summary = None if other == path else _verified(other)
            if summary is None or not wanted <= set(summary.channels):
                continue
            shared = [i for i in self.channels if i in summary.channels]
            if all(summary.channels[i].topic == self.channels[i].topic for i in shared):
                return {i: summary.channels[i] for i in wanted}, summary.schemas
        return {}, {}


def _verified(path: Path) -> Summary | None:
    try:
        with (
            path.open("rb") as stream,
            mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data,
        ):
            tail = read_tail(data)
    except (OSError, ValueError):
        return None
    return tail.summary if tail.trust is Trust.VERIFIED else None
