# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The topics of a bag while it is written: types, definitions, counts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from valve_twin.io.bags.definitions import definition, type_hash
from valve_twin.io.bags.file import BagFile, TopicDescription
from valve_twin.io.bags.metadata import TopicEntry
from valve_twin.io.errors import BagError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from valve_twin.io.bags.qos import QosProfile


@dataclass(slots=True)
class WrittenTopic:
    """A topic, its number in the file that took it last, and the messages written so far."""

    about: TopicDescription
    channel: int = 0
    file: BagFile | None = None
    count: int = 0

    def channel_in(self, file: BagFile) -> int:
        """Return the number of the topic in a file, which then knows it."""
        if self.file is not file:
            self.channel, self.file = file.declare(self.about), file
        return self.channel


class WrittenTopics(dict[str, WrittenTopic]):
    """All topics of a bag by name.

    Parameters
    ----------
    path : Path
        The bag, for messages.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path

    def __missing__(self, name: str) -> WrittenTopic:
        msg = f"{self._path}: topic '{name}' was not added; call add_topic first"
        raise BagError(msg)

    def add(
        self,
        name: str,
        type_name: str,
        qos: tuple[QosProfile, ...],
        *,
        message_definition: str | None,
        definition_hash: str | None,
        encoding: str,
    ) -> WrittenTopic:
        """Add a topic, or return it where it is known with the same type.

        Parameters
        ----------
        name, type_name : str
            Absolute name and full message type.
        qos : tuple of QosProfile
            What its publishers offer.
        message_definition, definition_hash : str, optional
            Full definition and hash; looked up where not given.
        encoding : str
            Kind of the definition.
        """
        known = self.get(name)
        if known is not None:
            if known.about.type != type_name:
                msg = (
                    f"{self._path}: topic '{name}' is of type {known.about.type}, "
                    f"not {type_name}; use another name"
                )
                raise BagError(msg)
            return known
        try:
            text = definition(type_name) if message_definition is None else message_definition
            digest = definition_hash if definition_hash is not None else type_hash(type_name, text)
        except (KeyError, ValueError) as err:
            msg = (
                f"{self._path}: topic '{name}': message type {type_name} is defined nowhere; "
                "install its package"
            )
            raise BagError(msg) from err
        about = TopicDescription(name, type_name, digest, qos, encoding, text)
        self[name] = WrittenTopic(about)
        return self[name]

    def offer(self, name: str, qos: tuple[QosProfile, ...]) -> None:
        """Note what the publishers of a topic offer now; it stands in the files that follow."""
        self[name].about.qos = qos

    def counts(self) -> dict[str, int]:
        """Return messages written by topic."""
        return {name: topic.count for name, topic in list(self.items())}

    def uncount(self, lost: Mapping[str, int]) -> None:
        """Take messages off that a failed write has lost."""
        for name, count in lost.items():
            self[name].count -= count

    def entries(self, counts: Sequence[Mapping[str, int]]) -> list[TopicEntry]:
        """Return what metadata.yaml says of the topics of files with these counts."""
        return [
            TopicEntry(a.name, a.type, a.type_hash, a.qos, sum(c.get(a.name, 0) for c in counts))
            for a in (t.about for t in self.values())
        ]
