# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which imported file each cycle of a bag comes from."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from typing import TYPE_CHECKING

from valve_twin.io.cdr.codec import decode_string
from valve_twin.io.config.topic_names import resolve_topic
from valve_twin.io.playback.player import read_messages
from valve_twin.io.tables.csv_import import RUN_TOPIC

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.io.bags.contents import BagInfo
    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.io.history.tables import CycleRecord

NOT_MEASURED = (
    "Times are NOT MEASURED: the files state none, or no unit (csv.times_measured); rates, time "
    "constants, delays, hours and dates are as doubtful as the time that was assumed."
)
"""What is said of a record whose times were invented."""


def cycle_files(
    config: ValveConfig, bag: BagInfo, cycles: Sequence[CycleRecord]
) -> dict[int, tuple[str, ...]]:
    """Return by the number of a cycle the imported files that it comes from.

    Parameters
    ----------
    config : ValveConfig
        The valve.
    bag : BagInfo
        What the bag holds; one that was not imported names no files.
    cycles : sequence of CycleRecord
        Closed cycles.

    Raises
    ------
    BagError
        If the bag cannot be read.
    """
    topic = resolve_topic(RUN_TOPIC, config.name)
    if not cycles or all(t.name != topic for t in bag.topics):
        return {}
    starts: list[int] = []
    names: list[str] = []
    for message in read_messages(bag.path, [topic]):
        starts.append(message.log_ns)
        names.append(decode_string(message.data))
    found = {}
    for cycle in cycles:
        first = max(bisect_right(starts, cycle.start_ns) - 1, 0)
        own = names[first : max(bisect_left(starts, cycle.end_ns), first + 1)]
        if own:
            found[cycle.cycle] = tuple(own)
    return found
