# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Count what the records of a chunk hold."""

from __future__ import annotations

import struct
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field

from valve_twin.io.mcap.format import MESSAGE_HEAD, Op
from valve_twin.io.mcap.summary import Summary, records_of

_NEVER = 2**64


@dataclass(slots=True)
class Walk(Summary):
    """What the records of a chunk hold, definitions included.

    Attributes
    ----------
    counts : Counter
        Messages by channel.
    start_ns, end_ns : int
        First and last log time [ns]; start_ns > end_ns where there is no message.
    end : int
        Where the last whole record ends [B].
    whole : bool
        Whether that is the end of the records.
    """

    counts: Counter[int] = field(default_factory=Counter)
    start_ns: int = _NEVER
    end_ns: int = -1
    end: int = 0
    whole: bool = False


def walk(records: bytes) -> Walk:
    """Count what the records of a chunk hold, up to the first that runs over their end."""
    found = Walk()
    for op, begin, stop in records_of(records):
        if op == Op.MESSAGE:
            if stop - found.end < MESSAGE_HEAD.size:
                break
            _, _, channel, _, log_ns, _ = MESSAGE_HEAD.unpack_from(records, found.end)
            found.counts[channel] += 1
            found.start_ns = min(found.start_ns, log_ns)
            found.end_ns = max(found.end_ns, log_ns)
        else:
            with suppress(struct.error, ValueError):
                found.add(op, records[begin:stop])
        found.end = stop
    found.whole = found.end == len(records)
    return found
