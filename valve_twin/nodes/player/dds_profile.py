# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Let Fast DDS ask for acknowledgement a hundred times a second rather than every three seconds.

A reliable writer learns what its readers lack only from their answers to its heartbeats. With the
default period of 3 s, what shared memory drops in a burst is sent again seconds later, and waiting
for acknowledgement takes up to 3 s a time.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

HEARTBEAT_S = 0.01
"""Pause between two heartbeats while something is not acknowledged [s]."""

_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")

_PROFILE = """<?xml version="1.0" encoding="UTF-8" ?>
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <profiles>
    <publisher profile_name="valve_twin_quick" is_default_profile="true">
      <times>
        <initialHeartbeatDelay><nanosec>1000000</nanosec></initialHeartbeatDelay>
        <heartbeatPeriod><sec>0</sec><nanosec>{period_ns}</nanosec></heartbeatPeriod>
        <nackResponseDelay><sec>0</sec><nanosec>1000000</nanosec></nackResponseDelay>
      </times>
    </publisher>
  </profiles>
</dds>
"""


def use_fast_heartbeat() -> None:
    """Give the middleware of this process its profile; to be called before it is initialised.

    A profile of the user's own is left alone, and so is any other middleware.
    """
    if any(os.environ.get(name) for name in _VARIABLES):
        return
    number, path = tempfile.mkstemp(prefix="valve_twin_", suffix=".xml")
    with os.fdopen(number, "w", encoding="ascii") as stream:
        stream.write(_PROFILE.format(period_ns=round(HEARTBEAT_S * 1e9)))
    os.environ[_VARIABLES[0]] = path
    _files.append(path)
    _made.append(path)


def remove_profile_file() -> None:
    """Remove the file of the profile; the middleware reads it when the first node is made."""
    while _files:
        Path(_files.pop()).unlink(missing_ok=True)
        os.environ.pop(_VARIABLES[0], None)


def has_fast_heartbeat() -> bool:
    """Return whether this process has the profile."""
    return bool(_made)


_files: list[str] = []
_made: list[str] = []
