# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which topics are recorded: names, types and expressions, combined as rosbag2 does."""

from __future__ import annotations

import re
from dataclasses import dataclass

from valve_twin.io.errors import ConfigError

_OF_ROS = ("/rosout", "/parameter_events")


@dataclass(frozen=True, slots=True)
class TopicChoice:
    """Choice of topics: whatever one of the inclusions names and no exclusion takes out.

    Attributes
    ----------
    everything : bool
        Take all topics.
    topics, types : tuple of str
        Absolute names and full message types to take.
    regex : str
        Take what this expression is found in; empty = nothing.
    exclude_topics, exclude_types : tuple of str
        Names and types to leave out.
    exclude_regex : str
        Leave out what this expression is found in; empty = nothing.
    hidden : bool
        Take also names with a part that begins with an underscore.
    namespace : str
        Where nothing is included by name, type or expression: take the topics of this namespace,
        with any prefix before it.
    """

    everything: bool = False
    topics: tuple[str, ...] = ()
    types: tuple[str, ...] = ()
    regex: str = ""
    exclude_topics: tuple[str, ...] = ()
    exclude_types: tuple[str, ...] = ()
    exclude_regex: str = ""
    hidden: bool = False
    namespace: str = "/"

    def check(self) -> None:
        """Raise for an expression that is none.

        Raises
        ------
        ConfigError
            Naming the expression and its fault.
        """
        for name in ("regex", "exclude_regex"):
            try:
                re.compile(getattr(self, name))
            except re.error as err:
                msg = (
                    f"parameter '{name}': '{getattr(self, name)}' is no regular expression: {err}"
                )
                raise ConfigError(msg) from err

    def takes(self, name: str, kind: str) -> bool:
        """Return whether a topic of that absolute name and type is chosen."""
        return self._included(name, kind) and not self._excluded(name, kind)

    def _included(self, name: str, kind: str) -> bool:
        if name in self.topics:
            return True
        if not self.hidden and "/_" in name:
            return False
        if self.everything or kind in self.types:
            return True
        if self.regex and re.search(self.regex, name):
            return True
        if self.topics or self.types or self.regex:
            return False
        return f"{self.namespace.rstrip('/')}/" in name and name not in _OF_ROS

    def _excluded(self, name: str, kind: str) -> bool:
        if name in self.exclude_topics or kind in self.exclude_types:
            return True
        return bool(self.exclude_regex and re.search(self.exclude_regex, name))
