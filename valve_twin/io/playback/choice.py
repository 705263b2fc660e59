# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which topics and which stretch of a bag are played, and under which names."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from valve_twin.core.quantity import suggest
from valve_twin.io.bags.read import BagInfo, bag_info, topic_name
from valve_twin.io.errors import BagError, ConfigError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path


@dataclass(frozen=True, slots=True)
class Choice:
    """Filter of topics.

    Attributes
    ----------
    topics : tuple of str
        These; with an empty `regex` too, empty = all.
    regex : str
        And those in whose name it is found.
    exclude_topics : tuple of str
        But not these.
    exclude_regex : str
        Nor those in whose name it is found.
    """

    topics: tuple[str, ...] = ()
    regex: str = ""
    exclude_topics: tuple[str, ...] = ()
    exclude_regex: str = ""

    def of(self, names: Iterable[str], where: str) -> list[str]:
        """Return the chosen ones of some names.

        Raises
        ------
        BagError
            If a wanted topic is not there (names the nearest) or nothing is left.
        ConfigError
            If an expression is none.
        """
        names = list(names)
        for name in self.topics:
            if topic_name(name) not in names:
                msg = f"{where}: there is no topic '{name}'; {suggest(name, names)}"
                raise BagError(msg)
        wanted = {topic_name(name) for name in self.topics}
        unwanted = {topic_name(name) for name in self.exclude_topics}
        takes, leaves = (
            _matcher(self.regex, "regex"),
            _matcher(self.exclude_regex, "exclude_regex"),
        )
        everything = not wanted and takes is None
        found = [
            name
            for name in names
            if (everything or name in wanted or (takes and takes.search(name)))
            and not (name in unwanted or (leaves and leaves.search(name)))
        ]
        if not found:
            msg = f"{where}: no topic is left to play; there are {', '.join(names)}"
            raise BagError(msg)
        return found


def _matcher(expression: str, key: str) -> re.Pattern[str] | None:
    if not expression:
        return None
    try:
        return re.compile(expression)
    except re.error as err:
        msg = f"key '{key}': '{expression}' is no regular expression ({err}); write /a/.* or so"
        raise ConfigError(msg) from err


def read_remaps(rules: Sequence[str]) -> dict[str, str]:
    """Return new names by old ones.

    Parameters
    ----------
    rules : sequence of str
        Each "/old:=/new"; the prefix is put before the new name as before any other.

    Raises
    ------
    ConfigError
        If a rule is none.
    """
    found: dict[str, str] = {}
    for rule in rules:
        old, sign, new = rule.partition(":=")
        names = [topic_name(n.strip()) for n in (old, new)]
        if not sign or any(not re.fullmatch(r"(/[A-Za-z_]\w*)+", n) for n in names):
            msg = f"key 'remap' cannot be '{rule}'; write /old:=/new"
            raise ConfigError(msg)
        found[names[0]] = names[1]
    return found


@dataclass(frozen=True, slots=True)
class Stretch:
    """Part of a bag, both ends belong to it; log times [ns]."""

    begin_ns: int
    end_ns: int

    def holds(self, at_ns: int) -> bool:
        """Return whether a log time lies in it."""
        return self.begin_ns <= at_ns <= self.end_ns


def stretch(
    path: str | Path, *, offset_ns: int = 0, duration_ns: int = 0, until_ns: int = 0
) -> Stretch:
    """Return the part of a bag that is to be played.

    Parameters
    ----------
    path : path
        The bag.
    offset_ns : int
        Begin this long after the first message [ns].
    duration_ns : int
        Bag time to play [ns], 0 or less = to the end.
    until_ns : int
        Log time to stop at [ns], 0 or less = the end. The earlier end counts.

    Raises
    ------
    BagError
        If nothing lies in it.
    """
    info: BagInfo = bag_info(path)
    begin = info.start_ns + max(offset_ns, 0)
    end = info.end_ns
    if duration_ns > 0:
        end = min(end, begin + duration_ns)
    if until_ns > 0:
        end = min(end, until_ns)
    if begin > info.end_ns:
        msg = (
            f"{path}: start offset {offset_ns * 1e-9:g} s is beyond its end; "
            f"it lasts {info.duration_s:g} s"
        )
        raise BagError(msg)
    if end < begin:
        msg = (
            f"{path}: nothing is left to play before log time {until_ns} ns; "
            f"the bag lies between {info.start_ns} and {info.end_ns} ns"
        )
        raise BagError(msg)
    return Stretch(begin, end)
