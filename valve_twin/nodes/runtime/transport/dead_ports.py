# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Whether a killed process left a port of shared memory that a living one still writes to.

Fast DDS gives a new process the port of a dead one, while a publisher may still have the dead
one's memory open: what it publishes then comes seconds late or never, to any reader of the new
process. The file `fastrtps_portN_el` (`fastdds_portN_el` of Fast DDS 3) is locked by whom the port
belongs to, so a lock that can be had tells of the dead. Where there is such a port, a node that
starts keeps off shared memory. So does every later one as long as a process has that very memory
open, told by its inode: the port looks alive again once somebody took it, and a twin that took the
port of the one before the last, which had kept off it, heard nothing for 10 to 18 s.
"""

from __future__ import annotations

import fcntl
import os
import re
import sys
import time
from contextlib import suppress
from pathlib import Path

_FIRST_PORT, _PORTS = 7400, 250
"""First port of domain 0 and ports of a domain, as DDS counts them."""

_NAME = r"(fast(?:rtps|dds)_port(\d+))"
_PORT = re.compile(_NAME)
_MAPPED = re.compile(rf" (\d+) +/\S*/{_NAME}( \(deleted\))?$", re.MULTILINE)
"""The end of a line of a process's maps: inode, path and whether it has been removed."""

_UNBORN_S = 2.0
"""A port that is not ready for so long has no maker: to make one takes microseconds [s]."""

_BEING_MADE_S = 0.2
"""A younger one may have a maker that cannot be seen from here, in another container [s]."""

_UNREADY = (0, 1)
_CORRUPTED = 3
"""First word of a managed segment of boost::interprocess; 2 = ready. Who waits leaves at 3 [1]."""


def domain_id() -> int:
    """Return the domain that the environment names."""
    text = os.environ.get("ROS_DOMAIN_ID", "")
    return int(text) if text.isdecimal() else 0


def domain_ports(domain: int) -> range:
    """Return the ports of a domain."""
    first = _FIRST_PORT + _PORTS * domain
    return range(first, first + _PORTS)


def remove_unborn(
    domain: int, memory: Path = Path("/dev/shm"), processes: Path = Path("/proc")
) -> None:
    """Remove ports whose makers were killed while they made them, and let go who waits for them.

    Whoever opens such a port waits in the creation of its participant until its maker says that it
    is ready, for ever and deaf to signals (boost::interprocess, `priv_open_or_create`).

    Parameters
    ----------
    domain : int
        ROS domain [1].
    memory, processes : Path
        Where the kernel shows shared memory and processes; nothing is found where it does not.
    """
    ports = domain_ports(domain)
    for path in memory.glob("fast*_port*"):
        port = _PORT.fullmatch(path.name)
        if port and int(port[2]) in ports:
            with suppress(OSError):  # somebody else removed it, or it is another user's
                _remove_unborn(path, processes)


def _remove_unborn(path: Path, processes: Path) -> None:
    """Remove a port that is not ready, where nobody is there who could make it so."""
    with path.open("r+b", buffering=0) as file:
        word = int.from_bytes(file.read(4), sys.byteorder)
        if word not in _UNREADY:
            return
        age_s = time.time() - os.fstat(file.fileno()).st_mtime
        if age_s > _UNBORN_S or (age_s > _BEING_MADE_S and not _is_open(path, processes)):
            if not os.path.samestat(os.fstat(file.fileno()), path.stat()):
                return  # another node of ours was faster, and a living port has the name
            path.unlink()
            path.with_name(f"sem.{path.name}_mutex").unlink(missing_ok=True)  # who waited held it
            file.seek(0)  # last: who waits makes the port anew at once
            file.write(_CORRUPTED.to_bytes(4, sys.byteorder))


def _is_open(path: Path, processes: Path) -> bool:
    """Return whether another process has a file of shared memory open."""
    own, there = str(os.getpid()), os.stat(path)
    for place in processes.glob("[0-9]*/fd/*"):
        with suppress(OSError):  # it has just been closed
            if place.parts[-3] != own and os.path.samestat(place.stat(), there):
                return True
    return False


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
    users, ports = set(), set()
    for path in processes.glob("[0-9]*/maps"):
        with suppress(OSError):  # it has just ended, or belongs to somebody else
            text = path.read_text(encoding="utf-8", errors="replace")
            found = [m for m in _MAPPED.finditer(text) if int(m[3]) in domain_ports(domain)]
            ports |= {(m[2], bool(m[4])) for m in found}
            users |= {f"{path.parent.name}:{m[1]}" for m in found}
    note = memory / f"valve_twin_dead_port_{domain}"
    if any(gone or _is_dead(memory / f"{name}_el") for name, gone in ports):
        _take_down(note, users)
        return True
    return bool(users & _taken_down(note))


def _take_down(note: Path, users: set[str]) -> None:
    """Remember who had what open when one was dead."""
    with suppress(OSError):  # of another user, whose nodes took the same down
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW | os.O_CLOEXEC
        file = os.open(note, flags, 0o644)
        try:
            os.write(file, " ".join(sorted(users)).encode())
        finally:
            os.close(file)


def _taken_down(note: Path) -> set[str]:
    try:
        return set(note.read_text(encoding="ascii", errors="replace").split())
    except OSError:
        return set()


def _is_dead(lock: Path) -> bool:
    try:
        with lock.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:  # held by the living, or not there
        return False
    return True
