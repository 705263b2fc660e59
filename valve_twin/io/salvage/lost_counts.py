# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Find out how many messages a damaged file once held, and settle what is lost."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

import yaml

from valve_twin.io.limits import load_yaml
from valve_twin.io.mcap.damage import Loss, total_lost
from valve_twin.io.salvage.tail import Tail, Trust

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from mcap.records import Channel

    from valve_twin.io.mcap.format import Statistics

_FILE_NAME, _ROOT = "metadata.yaml", "rosbag2_bagfile_information"


@dataclass(frozen=True, slots=True)
class _Expected:
    """What a file once held; None = unknown."""

    total: int | None = None
    topics: Counter[str] | None = None
    end_ns: int | None = None


def settle(
    losses: list[Loss],
    tail: Tail,
    found: Statistics,
    channels: Mapping[int, Channel],
    *,
    path: Path,
    size: int,
    chunks: int,
) -> tuple[tuple[Loss, ...], dict[str, int] | None, int | None]:
    """Complete the losses by what the file once held.

    Parameters
    ----------
    losses : list of Loss
        What was met.
    tail : Tail
        The end of the file.
    found : Statistics
        What is readable.
    channels : mapping
        Topics by number.
    path : Path
        The file; the metadata beside it tell what its summary does not.
    size : int
        Its size [B].
    chunks : int
        Chunks that were met [1].

    Returns
    -------
    tuple
        Losses in the order of the file, lost messages by topic, and in all; None = unknown.
    """
    losses = sorted(losses, key=lambda loss: (loss.offset, loss.length))
    present: Counter[str] = Counter()
    for i, n in found.counts.items():
        present[channels[i].topic] += n
    expected = _expected(path, tail, found, channels, present, chunks)
    if not tail.finished and tail.trust is Trust.MISSING:
        _tell_end(path, losses, found, expected, size)
    lost = None if expected.topics is None else dict(expected.topics - present)
    missing = None
    if expected.total is not None:
        missing = max(0, expected.total - found.message_count)
        _share_out(path, losses, missing, lost)
        _name_topics(losses, missing, lost)
    if tail.trust is not Trust.MISSING:  # else there may have been topics of which nothing is left
        for loss in losses:
            if loss.count is None and not loss.topics:
                loss.topics = tuple(sorted(c.topic for c in channels.values()))
    if missing is None:
        missing = total_lost(losses)
        if missing is not None:
            summed: Counter[str] = sum((Counter(loss.counts) for loss in losses), Counter())
            lost = dict(summed) if summed.total() == missing else None
    return tuple(losses), lost, missing


def _expected(
    path: Path,
    tail: Tail,
    found: Statistics,
    channels: Mapping[int, Channel],
    present: Counter[str],
    chunks: int,
) -> _Expected:
    """Return what a file held according to its summary, else to the metadata beside it."""
    stated = tail.summary.statistics
    if stated is not None:
        agrees = sum(stated.counts.values()) == stated.message_count and set(stated.counts) <= set(
            channels
        )
        topics: Counter[str] = Counter()
        for i, n in stated.counts.items():
            topics[channels[i].topic if i in channels else ""] += n
        believed = agrees and present <= topics
        if tail.trust is Trust.VERIFIED or (believed and stated.chunk_count in {0, chunks}):
            return _Expected(stated.message_count, topics if agrees else None, stated.end_ns)
        if believed and tail.trust is Trust.UNCHECKED:
            return _Expected(stated.message_count, topics, stated.end_ns)
    return _by_metadata(path, found.message_count, present)


def _by_metadata(path: Path, found: int, present: Counter[str]) -> _Expected:
    """Read the counts of the metadata.yaml beside a file; believed only where they add up."""
    try:
        text = (path.parent / _FILE_NAME).read_text(encoding="utf-8")
        root = load_yaml(text)[_ROOT]
        files = {str(f["path"]): f for f in root["files"]}
        own = files[path.name]
        topics = Counter(
            {
                str(t["topic_metadata"]["name"]): int(t["message_count"])
                for t in root["topics_with_message_count"]
            }
        )
        total = int(own["message_count"])
        counted = sum(int(f["message_count"]) for f in files.values())
        start = int(own["starting_time"]["nanoseconds_since_epoch"])
        end_ns = start + int(own["duration"]["nanoseconds"])
        agrees = int(root["message_count"]) == counted == topics.total()
    except (OSError, ValueError, TypeError, KeyError, AttributeError, yaml.YAMLError):
        return _Expected()
    alone = len(files) == 1
    if not agrees or total < found or (alone and not present <= topics):
        return _Expected()
    return _Expected(total, topics if alone else None, end_ns)


def _tell_end(
    path: Path, losses: list[Loss], found: Statistics, expected: _Expected, size: int
) -> None:
    """Say that the file ends too early, at the last damage where that reaches the end."""
    last = next((loss for loss in losses if loss.offset + loss.length == size), None)
    if last is None or not last.offset:
        reason = "the file ends too early: its recorder did not finish it, or it was cut"
        last = Loss(path, size, 0, "end", reason)
        losses.append(last)
    last.count, last.counts, last.topics, last.end_ns = None, {}, (), expected.end_ns
    if last.start_ns is None and found.message_count:
        last.start_ns = found.end_ns


def _share_out(
    path: Path, losses: list[Loss], missing: int, lost: Mapping[str, int] | None
) -> None:
    """Give the one loss without a count what the others leave."""
    known = sum(loss.count or 0 for loss in losses)
    rest = missing - known
    unknown = [loss for loss in losses if loss.count is None]
    if rest == 0:
        for loss in unknown:
            loss.count, loss.topics = 0, ()
    elif rest > 0 and not unknown:
        counts = dict(lost or {}) if not known else {}
        reason = f"the file once held {rest} more"
        losses.append(
            Loss(path, 0, 0, "messages", reason, tuple(counts), count=rest, counts=counts)
        )
    elif rest > 0 and len(unknown) == 1:
        named: Counter[str] = Counter(lost or {})
        for loss in losses:
            named.subtract(loss.counts)
        named = +named
        unknown[0].count, unknown[0].counts = rest, dict(named) if lost is not None else {}
        unknown[0].topics = tuple(sorted(named)) or unknown[0].topics


def _name_topics(losses: list[Loss], missing: int, lost: Mapping[str, int] | None) -> None:
    """Name the topics of the one place that lost messages where that place does not tell."""
    places = [loss for loss in losses if loss.count != 0]
    if lost and len(places) == 1 and places[0].count == missing:
        places[0].topics, places[0].counts = tuple(sorted(lost)), dict(lost)
