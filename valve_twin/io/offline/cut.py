# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Write a part of a bag as a bag of its own: a stretch of time, some topics, some cycles."""

from __future__ import annotations

import math
import shutil
from contextlib import ExitStack
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.io.bags.contents import bag_info, compare_with_data, open_file
from valve_twin.io.bags.folder import find_files
from valve_twin.io.bags.read import topic_name
from valve_twin.io.bags.writer import BagWriter
from valve_twin.io.errors import BagError, ConfigError
from valve_twin.io.offline.recover import Digests, declare, verify
from valve_twin.io.playback.choice import Choice
from valve_twin.io.playback.player import bag_topics, latched_before, read_messages

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.io.config.valve import ValveConfig

_SECOND_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class CutResult:
    """What was written; `latched` counts messages from before the cut that latched topics keep."""

    out: Path
    topics: dict[str, int]
    latched: int


def read_time(text: str, start_ns: int, what: str) -> int:
    """Return a log time [ns].

    Parameters
    ----------
    text : str
        Seconds after the begin of the bag, or a time of ISO 8601; without a zone it is UTC.
    start_ns : int
        Begin of the bag [ns].
    what : str
        Name of the option for the message.

    Raises
    ------
    ConfigError
        If it is neither.
    """
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if math.isfinite(seconds):
        return start_ns + round(seconds * _SECOND_NS)
    # Python 3.10 does not read the closing Z
    try:
        when = datetime.fromisoformat(text.strip().replace("Z", "+00:00"))
    except ValueError:
        msg = f"{what} cannot be '{text}'; write seconds such as 12.5, or 2026-01-31T08:00:00Z"
        raise ConfigError(msg) from None
    when = when if when.tzinfo is not None else when.replace(tzinfo=timezone.utc)
    whole = when.replace(microsecond=0)
    return round(whole.timestamp()) * _SECOND_NS + when.microsecond * 1000


def cut(
    path: str | Path,
    out: str | Path,
    *,
    from_ns: int = 0,
    until_ns: int | None = None,
    topics: Sequence[str] = (),
) -> CutResult:
    """Write the messages of a stretch of time, both ends included, into a new bag and verify it.

    Parameters
    ----------
    path : path
        The bag; of a damaged one what is intact.
    out : path
        Folder to make; it must not exist.
    from_ns, until_ns : int
        First and last log time [ns]; None = the end.
    topics : sequence of str
        Only these; empty = all.

    Returns
    -------
    CutResult
        What was written. The last messages of latched topics from before the cut are written at
        its begin: who plays it gets them as a late subscriber would have.

    Raises
    ------
    BagError
        If the bag cannot be read, nothing lies in the stretch, or the new bag cannot be written.
    """
    compare_with_data(path)
    chosen = bag_topics(path, Choice(topics=tuple(topics)))
    names = [t.name for t in chosen]
    depths = {t.name: max(1, t.qos.depth) for t in chosen if t.qos.is_latched}
    out = Path(out)
    digests = Digests()
    before = latched_before(path, depths, from_ns) if depths and from_ns > 0 else []
    bag = BagWriter(out, flush_s=math.inf)
    try:
        with bag:
            _declare_all(path, bag, set(names))
            bag.note({**bag_info(path).custom, "cut_from": Path(path).resolve().name})
            held = [replace(m, log_ns=from_ns) for m in before]
            for part in (held, read_messages(path, names, from_ns=from_ns, until_ns=until_ns)):
                for m in part:
                    bag.write(m.topic, m.data, log_ns=m.log_ns, publish_ns=m.publish_ns)
                    digests.add(m.topic, m.log_ns, m.publish_ns, m.data)
        _check(path, sum(digests.counts.values()) - len(before))
        verify(out, digests)
    except BaseException:
        shutil.rmtree(out, ignore_errors=True)
        raise
    return CutResult(out, digests.counts, len(before))


def _check(path: str | Path, count: int) -> None:
    if not count:
        msg = f"{path}: no message lies in the stretch to be cut out; give another"
        raise BagError(msg)


def _declare_all(path: str | Path, bag: BagWriter, names: set[str]) -> None:
    """Add the topics as the files of the bag describe them."""
    with ExitStack() as stack:
        for file in (open_file(name, stack) for name in find_files(path).files):
            for channel in file.summary.channels.values():
                name = topic_name(channel.topic)
                if name not in names:
                    continue
                schema = file.summary.schemas.get(channel.schema_id)
                problem = declare(bag, replace(channel, topic=name), schema)
                if problem:
                    msg = f"{path}: topic '{name}': {problem}; leave it out with --topics"
                    raise BagError(msg)


def cycles_span(path: str | Path, config: ValveConfig, cycles: str) -> tuple[int, int]:
    """Return first and last log time of some cycles [ns].

    Parameters
    ----------
    path : path
        The bag.
    config : ValveConfig
        How its cycles are found.
    cycles : str
        "N" or "N..M", as `valve-twin estimate` numbers them.

    Raises
    ------
    BagError
        If there are no such cycles.
    ConfigError
        If that is no range.
    """
    from valve_twin.io.offline.run import run_bag

    first, _, last = cycles.partition("..")
    try:
        low, high = int(first), int(last or first)
    except ValueError:
        msg = f"--cycles cannot be '{cycles}'; write N or N..M"
        raise ConfigError(msg) from None
    found = run_bag(config, path).cycles
    wanted = [c for c in found if low <= c.cycle <= high]
    if not wanted:
        have = f"{found[0].cycle}..{found[-1].cycle}" if found else "none"
        msg = f"{path}: there is no cycle {cycles}; it has {have}"
        raise BagError(msg)
    margin = round(config.hold_back_s * _SECOND_NS)
    return min(c.start_ns for c in wanted) - margin, max(c.end_ns for c in wanted) + margin
