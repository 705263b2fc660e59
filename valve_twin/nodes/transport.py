# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Two profiles of Fast DDS: quick acknowledgement, and a port that no dead process has had.

A reliable writer learns what its readers lack only from their answers to its heartbeats. With the
default period of 3 s, what shared memory drops in a burst is sent again seconds later, and waiting
for acknowledgement takes up to 3 s a time.

A process takes the lowest free port for its data, so the successor of a killed one takes that of
the dead. A publisher that still has the dead one's shared memory open under that port goes on
writing there, often for seconds and sometimes as long as it lives, and the new one is matched and
receives nothing.
"""

from __future__ import annotations

import os
import secrets
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

_PORT_PROFILE = """<?xml version="1.0" encoding="UTF-8" ?>
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <profiles>
    <participant profile_name="valve_twin_own_port" is_default_profile="true">
      <rtps><port><offsetd3>{offset}</offsetd3></port></rtps>
    </participant>
  </profiles>
</dds>
"""

_FIRST_PORT, _PORTS_A_DOMAIN = 7400, 250
_PARTICIPANTS = 32
"""Participants of a machine that find each other [1]; each takes the second next port."""

_OFFSETS = range(75, _PORTS_A_DOMAIN - 2 * _PARTICIPANTS, 2)
"""Begin of the data ports within those of the domain; by default it is 11."""

_PORT_FILE = "fastrtps_port"


def quicken() -> None:
    """Give the middleware of this process its profile; to be called before it is initialised.

    A profile of the user's own is left alone, and so is any other middleware.
    """
    if _give(_PROFILE.format(period_ns=round(HEARTBEAT_S * 1e9))):
        _made.append(os.environ[_VARIABLES[0]])


def own_port(memory: Path = Path("/dev/shm")) -> None:
    """Give the data of this process a port of its own; to be called before it is initialised.

    It lies among those of the domain, so that a firewall lets it through. A profile of the user's
    own is left alone, and so is any other middleware.

    Parameters
    ----------
    memory : path
        Where Fast DDS keeps a file a port; those of killed processes stay there.
    """
    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not domain.isdecimal():
        return
    first = _FIRST_PORT + _PORTS_A_DOMAIN * int(domain)
    had = {path.name for path in memory.glob(f"{_PORT_FILE}*")}

    def taken(offset: int) -> int:
        ports = range(first + offset, first + offset + 2 * _PARTICIPANTS, 2)
        return sum(f"{_PORT_FILE}{port}" in had for port in ports)

    counts = {offset: taken(offset) for offset in _OFFSETS}
    fewest = min(counts.values())
    offset = secrets.choice([offset for offset, count in counts.items() if count == fewest])
    _give(_PORT_PROFILE.format(offset=offset))


def _give(profile: str) -> bool:
    """Have the middleware read a profile; return whether it is not the user's who gives one."""
    if any(os.environ.get(name) for name in _VARIABLES):
        return False
    number, path = tempfile.mkstemp(prefix="valve_twin_", suffix=".xml")
    with os.fdopen(number, "w", encoding="ascii") as stream:
        stream.write(profile)
    os.environ[_VARIABLES[0]] = path
    _files.append(path)
    return True


def tidy() -> None:
    """Remove what `quicken` or `own_port` wrote; the first node has read it."""
    while _files:
        Path(_files.pop()).unlink(missing_ok=True)
        os.environ.pop(_VARIABLES[0], None)


def is_quick() -> bool:
    """Return whether this process has the quick profile."""
    return bool(_made)


_files: list[str] = []
_made: list[str] = []
