# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How Fast DDS carries what a node says: announced from a thread, over UDP, asked for often.

A participant of Fast DDS 2 announces itself before its receivers are attached (in
`RTPSParticipantImpl::enable`), and to 32 ports one after the other where discovery is local. Who
knows it already answers once, within 0.3 ms; an answer that comes before they are attached is
dropped, and the next is that participant's own announcement, up to 3 s later. So a third to a half
of all nodes that were started beside running ones saw these late. Where the throughput of a
participant is bounded, its announcements go out from a thread of their own, and the answers find
the receivers there; the bound is more than any machine sends.

The player asks for what is missing a hundred times a second. A reliable writer learns what its
readers lack only from their answers to its heartbeats. With the default period of 3 s, what is
dropped in a burst is sent again seconds later, and waiting for acknowledgement takes up to 3 s a
time.

Shared memory does not survive a subscriber that stands still: after 1 s its port is taken for
dead, every further message removes and makes it anew, and a subscriber that goes on meanwhile may
be left with a port that nobody writes to, or leave the writer in an endless loop
(eProsima/Fast-DDS issues 6484 and 5469, pull request 4737; all there in 2.14.5). A socket has no
such state. Any node that follows a killed process keeps off it, too (`dead_ports.py`).

Participants of one process, as the gateway's two, tell each other over the wire of what they have.
Where they call each other instead, as they do by default, what one makes or removes while it meets
the other can be lost for good: of 185 pairs 4 never met, of 36 whose announcements come from a
thread 9, of 800 over the wire none (`docs/developers/upstream.md`).
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

HEARTBEAT_S = 0.01
"""Pause between two heartbeats while something is not acknowledged [s]."""

BUFFER_B = 4 * 2**20
"""Wanted of the kernel for what has arrived and was not taken yet; it gives `net.core.rmem_max` at
most [B]."""

LEASE_S = 4
"""A node that was killed is waited for so long: a reliable publisher that loses nothing, as a
simulated valve at another rate than 1, stands still meanwhile; 20 by default [s]."""

_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
_TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_LOCAL_ONLY = "ROS_LOCALHOST_ONLY"

_NAMES = (
    ("heartbeatPeriod", "heartbeat_period"),
    ("initialHeartbeatDelay", "initial_heartbeat_delay"),
    ("nackResponseDelay", "nack_response_delay"),
)
"""Elements that Fast DDS 3 (ROS 2 Kilted) names otherwise; it refuses a file with the old ones."""

_PROFILE = """<?xml version="1.0" encoding="UTF-8" ?>
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <profiles>{parts}
  </profiles>
  <library_settings>
    <intraprocess_delivery>USER_DATA_ONLY</intraprocess_delivery>
  </library_settings>
</dds>
"""

_QUICK = """
    <publisher profile_name="valve_twin_quick" is_default_profile="true">
      <times>
        <initialHeartbeatDelay><nanosec>1000000</nanosec></initialHeartbeatDelay>
        <heartbeatPeriod><sec>0</sec><nanosec>{period_ns}</nanosec></heartbeatPeriod>
        <nackResponseDelay><sec>0</sec><nanosec>1000000</nanosec></nackResponseDelay>
      </times>
    </publisher>"""

_ANNOUNCED_FROM_A_THREAD = """
        <throughputController>
          <bytesPerPeriod>2000000000</bytesPerPeriod><periodMillisecs>1000</periodMillisecs>
        </throughputController>"""
"""Not known to Fast DDS 3."""

_LEASE = f"""
          <discovery_config>
            <leaseDuration><sec>{LEASE_S}</sec></leaseDuration>
            <leaseAnnouncement><sec>1</sec></leaseAnnouncement>
          </discovery_config>"""

_PLAIN = """
    <participant profile_name="valve_twin" is_default_profile="true">
      <rtps>{thread}
        <builtin>{lease}
        </builtin>
      </rtps>
    </participant>"""

_UDP = """
    <participant profile_name="valve_twin_udp" is_default_profile="true">
      <rtps>{thread}
        <builtinTransports>UDPv4</builtinTransports>
        <listenSocketBufferSize>{buffer}</listenSocketBufferSize>
        <builtin>{lease}
        </builtin>
      </rtps>
    </participant>"""

_UDP_HERE = """
    <transport_descriptors>
      <transport_descriptor>
        <transport_id>valve_twin_here</transport_id>
        <type>UDPv4</type>
        <receiveBufferSize>{buffer}</receiveBufferSize>
        <maxInitialPeersRange>32</maxInitialPeersRange>
      </transport_descriptor>
    </transport_descriptors>
    <participant profile_name="valve_twin_udp" is_default_profile="true">
      <rtps>{thread}
        <useBuiltinTransports>false</useBuiltinTransports>
        <userTransports><transport_id>valve_twin_here</transport_id></userTransports>
        <builtin>{lease}
          <metatrafficUnicastLocatorList><locator><udpv4/></locator></metatrafficUnicastLocatorList>
          <initialPeersList>
            <locator><udpv4><address>127.0.0.1</address></udpv4></locator>
          </initialPeersList>
        </builtin>
      </rtps>
    </participant>"""


def use_fast_heartbeat(*, over_udp: bool = False) -> None:
    """Give the middleware of this process its profile; to be called before it is initialised.

    A profile of the user's own is left alone, so are transports of the user's own and any other
    middleware.

    Parameters
    ----------
    over_udp : bool
        Keep off shared memory.
    """
    if not _is_ours():
        return
    quick = _QUICK.format(period_ns=round(HEARTBEAT_S * 1e9))
    for old, new in _NAMES if is_fast_dds_3() else ():
        quick = quick.replace(old, new)
    _use((_udp() if over_udp else _plain()) + quick)
    _quick.append(True)


def keep_off_shared_memory() -> None:
    """Let the middleware of this process use UDP alone; to be called before it is initialised.

    Left alone is what `use_fast_heartbeat` leaves alone.
    """
    if _is_ours():
        _use(_udp())


def announce_from_a_thread() -> None:
    """Let the middleware of this process hear who answers it at once; before it is initialised.

    Left alone is what `use_fast_heartbeat` leaves alone.
    """
    if _is_ours():
        _use(_plain())


def _is_ours() -> bool:
    """Return whether nobody else says how the middleware is to be."""
    return not any(os.environ.get(name) for name in _VARIABLES) and _is_fast_dds()


def _use(parts: str) -> None:
    """Write a profile of some parts for the middleware to read."""
    if not parts:
        return
    number, path = tempfile.mkstemp(prefix="valve_twin_", suffix=".xml")
    with os.fdopen(number, "w", encoding="ascii") as stream:
        stream.write(_PROFILE.format(parts=parts))
    os.environ[_VARIABLES[is_fast_dds_3()]] = path
    _files.append(path)


def _is_fast_dds() -> bool:
    """Return whether nobody asks for another middleware, which would read the range alone."""
    wanted = os.environ.get("RMW_IMPLEMENTATION", "")
    return not wanted or wanted.startswith("rmw_fastrtps")


def is_fast_dds_3() -> bool:
    """Return whether the ROS 2 of this process comes with Fast DDS 3, by the name it installs."""
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return any(Path(prefix, "share", "fastdds").is_dir() for prefix in filter(None, prefixes))


def _udp() -> str:
    """Return the part of the profile that keeps off shared memory, in the range that is wanted.

    It leaves transports alone where the user says which are to be. Told of the range LOCALHOST,
    rmw_fastrtps adds shared memory whatever the profile says; so the profile says what that range
    means and the middleware is left to it.
    """
    if os.environ.get(_TRANSPORTS):
        return _plain()
    if os.environ.get(_LOCAL_ONLY) == "1":  # the older name; it goes before range and peers
        del os.environ[_LOCAL_ONLY]
    elif os.environ.get(_RANGE) != "LOCALHOST" or os.environ.get("ROS_STATIC_PEERS"):
        return _UDP.format(buffer=BUFFER_B, thread=_thread(), lease=_LEASE)
    os.environ[_RANGE] = "SYSTEM_DEFAULT"
    return _UDP_HERE.format(buffer=BUFFER_B, thread=_thread(), lease=_LEASE)


def _plain() -> str:
    """Return the part of the profile that leaves the transports as they are."""
    return "" if is_fast_dds_3() else _PLAIN.format(thread=_thread(), lease=_LEASE)


def _thread() -> str:
    return "" if is_fast_dds_3() else _ANNOUNCED_FROM_A_THREAD


def remove_profile_file() -> None:
    """Remove the file of the profile; the middleware reads it when the first node is made."""
    while _files:
        Path(_files.pop()).unlink(missing_ok=True)
        for name in _VARIABLES:
            os.environ.pop(name, None)


def has_fast_heartbeat() -> bool:
    """Return whether this process asks for what is missing a hundred times a second."""
    return bool(_quick)


_files: list[str] = []
_quick: list[bool] = []
