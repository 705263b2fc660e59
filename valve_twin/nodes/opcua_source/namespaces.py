# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Namespaces of a server: an index means the one that it meant first, also after a restart."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.nodes.opcua_source.complaints import plain

if TYPE_CHECKING:
    from collections.abc import Sequence

OWN = 2
"""Indices below are those of the standard and of the server itself, whose name may change [1]."""


class Namespaces:
    """Finds the namespaces of tags again.

    An index is a place in a list that the server makes at its start: after an update of the PLC
    the same id can be another tag.
    """

    def __init__(self) -> None:
        self._first: dict[int, str] = {}
        self._now: list[str] = []

    def see(self, uris: Sequence[str | None]) -> None:
        """Note the list of the server.

        Parameters
        ----------
        uris : sequence of str or None
            As it is now; what is no text counts as nameless.
        """
        self._now = [uri if isinstance(uri, str) else "" for uri in uris]

    def index(self, index: int) -> int | None:
        """Return which index a namespace has now; None where it is gone.

        Parameters
        ----------
        index : int
            The one that is configured.
        """
        now = self._now[index] if index < len(self._now) else ""
        if index < OWN or not self._now:
            return index
        first = self._first.setdefault(index, now) if now else self._first.get(index, "")
        if first in {now, ""}:
            return index
        return self._now.index(first) if first in self._now else None

    def moved(self, index: int) -> str:
        """Return what became of a namespace, in one line.

        Parameters
        ----------
        index : int
            The one that is configured.
        """
        first, at = plain(self._first.get(index, "")), self.index(index)
        now = plain(self._now[index]) if index < len(self._now) else "nothing"
        if at == index:
            return ""
        if at is None:
            return f"the namespace {first} is gone, ns={index} is {now} now"
        where = f"has moved from ns={index} to ns={at}, where its tags are taken"
        return f"the namespace {first} {where}"
