# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Stamps to messages and back; a node that needs no estimate loads nothing else for it."""

from __future__ import annotations

from builtin_interfaces.msg import Time

SECOND_NS = 1_000_000_000
_MAX_NS = (2**31 - 1) * SECOND_NS


def to_time(stamp_ns: int) -> Time:
    """Return a stamp as a message; what a header cannot hold becomes its nearest end."""
    sec, nanosec = divmod(min(max(int(stamp_ns), 0), _MAX_NS), SECOND_NS)
    return Time(sec=sec, nanosec=nanosec)


def from_time(time: Time) -> int:
    """Return a stamp in nanoseconds."""
    return int(time.sec) * SECOND_NS + int(time.nanosec)
