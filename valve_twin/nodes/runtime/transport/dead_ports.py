# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Whether a killed process left a port of shared memory that a living one still writes to.

Fast DDS gives a new process the port of a dead one, while a publisher may still have the dead
one's memory open: what it publishes then comes seconds late or never, to any reader of the new
process. The file `fastrtps_portN_el` (`fastdds_portN_el` of Fast DDS 3) is locked by whom the port
belongs to, so a lock that can be had tells of the dead. Where there is such a port, a node that
starts keeps off shared memory.
"""

from __future__ import annotations

import fcntl
import os
import re
from contextlib import suppress
from pathlib import Path

_FIRST_PORT, _PORTS = 7400, 250
"""First port of domain 0 and ports of a domain, as DDS counts them."""

_MAPPED = re.compile(r"/(fast(?:rtps|dds)_port(\d+))( \(deleted\))?$", re.MULTILINE)


def domain_id() -> int:
    """Return the domain that the environment names."""
    text = os.environ.get("ROS_DOMAIN_ID", "")
    return int(text) if text.isdecimal() else 0


def has_dead_port(
    domain: int, memory: Path = Path("/dev/shm"), processes: Path = Path("/proc")
) -> bool:
    """Return whether a living process has open what a dead one of a domain left.

    Parameters
    ----------
    domain : int
        ROS domain [1].
    memory, processes : Path
        Where the kernel shows shared memory and processes; nothing is found where it does not.
    """
    first = _FIRST_PORT + _PORTS * domain
    found: set[tuple[str, int, bool]] = set()
    for path in processes.glob("[0-9]*/maps"):
        with suppress(OSError):  # it has just ended, or belongs to somebody else
            text = path.read_text(encoding="utf-8", errors="replace")
            found |= {(m[1], int(m[2]), bool(m[3])) for m in _MAPPED.finditer(text)}
    ports = {(name, gone) for name, port, gone in found if first <= port < first + _PORTS}
    return any(gone or _is_dead(memory / f"{name}_el") for name, gone in ports)


def _is_dead(lock: Path) -> bool:
    try:
        with lock.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:  # held by the living, or not there
        return False
    return True
