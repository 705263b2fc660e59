# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Names of valves as MQTT can carry them; different valves never share one."""

from __future__ import annotations

import re
from urllib.parse import quote

from valve_twin.io.errors import ConfigError

_SAFE = re.compile(r"[^/+#\x00-\x1f\x7f]+")


def topic_path(valve: str) -> str:
    """Return the levels of a valve's topic: /press/valve_1 -> press/valve_1."""
    return "/".join(_level(part) for part in valve.removeprefix("/").split("/"))


def device_id(valve: str) -> str:
    """Return the id of its Sparkplug device, which may hold no slash: press.valve_1."""
    levels = valve.removeprefix("/").split("/")
    return ".".join(_level(part).replace(".", "%2E") for part in levels)


def checked_id(what: str, given: str) -> str:
    """Return an id that a user chose.

    Raises
    ------
    ConfigError
        If no topic can hold it.
    """
    if _SAFE.fullmatch(given):
        return given
    msg = f"MQTT: {what} '{given}' is no level of a topic: leave out / + # and control characters"
    raise ConfigError(msg)


def _level(part: str) -> str:
    """Return a part of a name with what is special percent-encoded; an empty one as %00."""
    return quote(part, safe=" !$&'()*,:;=@", errors="replace") or "%00"
