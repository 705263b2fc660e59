# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Find out how many messages a damaged file once held, and settle what is lost."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import yaml

from valve_twin.io.mcap.damage import Loss, total_lost
from valve_twin.io.salvage.tail import Tail, Trust

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from valve_twin.io.mcap.format import Channel, Statistics

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_FILE_NAME, _ROOT = "metadata.yaml", "rosbag2_bagfile_information"


@dataclass(frozen=True, slots=True)
class Expected:
    """What a file once held; None = unknown."""

    total: int | None = None
    topics: Mapping[str, int] | None = None
    end_ns: int | None = None


def expected_counts(
    path: Path, tail: Tail, found: Statistics, channels: Mapping[int, Channel], chunks: int
) -> Expected:
    """Return what a file held according to its summary, else to the metadata beside it.

    Parameters
    ----------
    path : Path
        The file.
    tail : Tail
        Its end.
    found : Statistics
        What is still readable.
    channels : mapping
        Topics by number.
    chunks : int
        Chunks that were met.
    """
    told = tail.summary.statistics
    names = {i: c.topic for i, c in channels.items()}
    present = {names[i]: n for i, n in found.counts.items() if i in names}
    if told is not None:
        agrees = sum(told.counts.values()) == told.message_count and set(told.counts) <= set(names)
        topics: dict[str, int] = {}
        for i, n in told.counts.items():
            name = names.get(i, "")
            topics[name] = topics.get(name, 0) + n
        believed = agrees and told.chunk_count in {0, chunks} and _covers(topics, present)
        if tail.trust is Trust.VERIFIED or believed:
            return Expected(told.message_count, topics if agrees else None, told.end_ns)
        if agrees and tail.trust is Trust.UNCHECKED and _covers(topics, present):
            return Expected(told.message_count, topics, told.end_ns)
    return _by_metadata(path, found.message_count, present)


def _covers(expected: Mapping[str, int], present: Mapping[str, int]) -> bool:
    return all(expected.get(name, 0) >= n for name, n in present.items())


def _by_metadata(path: Path, found: int, present: Mapping[str, int]) -> Expected:
    """Read the counts of the metadata.yaml beside a file; believed only where they add up."""
    try:
        text = (path.parent / _FILE_NAME).read_text(encoding="utf-8")
        root = yaml.load(text, _LOADER)[_ROOT]  # a safe loader, the fast one
        files = {str(f["path"]): f for f in root["files"]}
        own = files[path.name]
        topics = {
            str(t["topic_metadata"]["name"]): int(t["message_count"])
            for t in root["topics_with_message_count"]
        }
        total = int(own["message_count"])
        counted = sum(int(f["message_count"]) for f in files.values())
        start = int(own["starting_time"]["nanoseconds_since_epoch"])
        end_ns = start + int(own["duration"]["nanoseconds"])
        agrees = int(root["message_count"]) == counted == sum(topics.values())
    except (OSError, ValueError, TypeError, KeyError, AttributeError, yaml.YAMLError):
        return Expected()
    if not agrees or total < found:
        return Expected()
    alone = len(files) == 1 and _covers(topics, present)
    if len(files) == 1 and not alone:
        return Expected()
    return Expected(total, topics if alone else None, end_ns)


def settle(
    path: Path,
    losses: list[Loss],
    found: Statistics,
    channels: Mapping[int, Channel],
    expected: Expected,
    tail: Tail,
    size: int,
) -> tuple[tuple[Loss, ...], dict[str, int] | None, int | None]:
    """Complete the losses by what the file once held.

    Parameters
    ----------
    path : Path
        The file.
    losses : list of Loss
        What was met.
    found : Statistics
        What is readable.
    channels : mapping
        Topics by number.
    expected : Expected
        What the file once held.
    tail : Tail
        The end of the file.
    size : int
        Its size [B].

    Returns
    -------
    tuple
        Losses in the order of the file, lost messages by topic, and in all; None = unknown.
    """
    settled = sorted(losses, key=lambda loss: (loss.offset, loss.length))
    names = tuple(sorted(c.topic for c in channels.values()))
    present: dict[str, int] = {}
    for i, n in found.counts.items():
        topic = channels[i].topic
        present[topic] = present.get(topic, 0) + n
    if not tail.finished and tail.trust is Trust.MISSING:
        settled = _with_end(path, settled, found, expected, size)
    missing = None
    if expected.total is not None:
        missing = max(0, expected.total - found.message_count)
    lost = _by_topic(expected, present)
    if missing is not None:
        settled = _named(_shared_out(path, settled, missing, lost), missing, lost)
    if tail.trust is not Trust.MISSING:  # else there may have been topics of which nothing is left
        settled = [
            replace(loss, topics=names) if loss.count is None and not loss.topics else loss
            for loss in settled
        ]
    if missing is None:
        missing = total_lost(settled)
        if missing is not None:
            lost = _summed(settled, missing)
    return tuple(settled), lost, missing


def _with_end(
    path: Path, losses: list[Loss], found: Statistics, expected: Expected, size: int
) -> list[Loss]:
    """Say that the file ends too early, at the last damage where that reaches the end."""
    last = next((loss for loss in losses if loss.offset + loss.length == size), None)
    began = found.end_ns if found.message_count else None
    if last is not None and last.offset:
        ended = replace(last, end_ns=expected.end_ns, count=None, counts={}, topics=())
        ended = replace(ended, start_ns=last.start_ns if last.start_ns is not None else began)
        return [ended if loss is last else loss for loss in losses]
    reason = "the file ends too early: its recorder did not finish it, or it was cut"
    end = Loss(path, size, 0, "end", reason, start_ns=began, end_ns=expected.end_ns, count=None)
    return [*losses, end]


def _by_topic(expected: Expected, present: Mapping[str, int]) -> dict[str, int] | None:
    if expected.topics is None:
        return None
    missing = {n: c - present.get(n, 0) for n, c in expected.topics.items()}
    return {n: c for n, c in missing.items() if c > 0}


def _shared_out(
    path: Path, losses: list[Loss], missing: int, lost: Mapping[str, int] | None
) -> list[Loss]:
    """Give the one loss without a count what the others leave."""
    known = sum(loss.count or 0 for loss in losses)
    rest = missing - known
    if rest == 0:
        return [replace(x, count=0, topics=()) if x.count is None else x for x in losses]
    open_places = [i for i, loss in enumerate(losses) if loss.count is None]
    if rest < 0:
        return losses
    if not open_places:
        reason = f"the file once held {rest} more"
        counts = dict(lost or {}) if not known else {}
        more = Loss(
            path, 0, 0, "messages", reason, topics=tuple(counts), count=rest, counts=counts
        )
        return [*losses, more]
    if len(open_places) > 1:
        return losses
    place = open_places[0]
    counts = dict(lost) if lost is not None else {}
    for loss in losses:
        for name, n in loss.counts.items():
            counts[name] = counts.get(name, 0) - n
    counts = {n: c for n, c in counts.items() if c > 0}
    exact = replace(losses[place], count=rest, counts=counts if lost is not None else {})
    if counts:
        exact = replace(exact, topics=tuple(sorted(counts)))
    return [*losses[:place], exact, *losses[place + 1 :]]


def _named(losses: list[Loss], missing: int, lost: Mapping[str, int] | None) -> list[Loss]:
    """Name the topics of the one place that lost messages where that place does not tell."""
    places = [i for i, loss in enumerate(losses) if loss.count != 0]
    if not lost or len(places) != 1 or losses[places[0]].count != missing:
        return losses
    named = list(losses)
    named[places[0]] = replace(losses[places[0]], topics=tuple(sorted(lost)), counts=dict(lost))
    return named


def _summed(losses: list[Loss], missing: int) -> dict[str, int] | None:
    summed: dict[str, int] = {}
    for loss in losses:
        for name, n in loss.counts.items():
            summed[name] = summed.get(name, 0) + n
    return summed if sum(summed.values()) == missing else None
