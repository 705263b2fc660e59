# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Report what a bag holds and what is damaged in it, as plain values and as lines."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from valve_twin.io.bags.contents import contents, wrong_counts
from valve_twin.io.bags.folder import find_files
from valve_twin.io.bags.qos import read_profiles
from valve_twin.io.mcap.damage import time_text
from valve_twin.io.mcap.reader import McapFile
from valve_twin.io.salvage.read import salvage, salvage_file

if TYPE_CHECKING:
    from valve_twin.io.bags.contents import TopicInfo
    from valve_twin.io.mcap.damage import Loss


class TopicReport(TypedDict):
    """One topic."""

    name: str
    type: str
    count: int | None
    rate_hz: float | None
    qos: list[dict[str, object]]


class BagReport(TypedDict):
    """What a bag holds; times in ns, sizes in bytes, None = unknown."""

    bag: str
    files: list[str]
    size: int
    start_ns: int
    end_ns: int
    start: str
    duration_s: float
    messages: int | None
    topics: list[TopicReport]
    compression: list[str]
    custom: dict[str, str]
    damaged: bool
    lost_messages: int | None
    unverified_messages: int
    damage: list[dict[str, object]]
    notes: list[str]


def bag_report(path: str | Path, *, verify: bool = False) -> BagReport:
    """Report what a bag holds.

    Parameters
    ----------
    path : path
        Bag folder, metadata.yaml or .mcap file.
    verify : bool
        Read every chunk and check its sum; else what the summaries say is believed as long as
        they are sound.

    Returns
    -------
    BagReport
        Plain values.

    Raises
    ------
    BagError
        If there is no such bag or nothing in it is intact.
    """
    folder = find_files(path)
    place = Path(path) if Path(path).is_dir() else Path(path).parent
    notes = [folder.flaw] if folder.flaw else []
    notes += [f"{p}: the file is missing" for p in folder.missing]
    losses: list[Loss] = []
    lost: int | None = None if folder.missing else 0
    unverified = 0
    custom: dict[str, str] = {}
    kinds: set[str] = set()
    with ExitStack() as stack:
        opened = []
        for name in folder.files:
            if name in folder.missing:
                continue
            file = McapFile(name, salvage=salvage, salvaged=salvage_file(name) if verify else None)
            stack.callback(file.close)
            opened.append(file)
            custom |= file.summary.metadata.get("valve_twin", {})
            kinds |= {c.compression or "none" for c in file.summary.chunks}
            if file.damage is not None:
                losses += file.damage.losses
                unverified += file.damage.unverified_count
                part = file.damage.lost_count
                lost = None if lost is None or part is None else lost + part
        info = contents(Path(path), opened, {**custom, **folder.custom})
        notes += filter(None, [wrong_counts(folder, opened, info)])
    return BagReport(
        bag=str(path),
        files=[str(p.relative_to(place)) for p in info.files],
        size=info.size,
        start_ns=info.start_ns,
        end_ns=info.end_ns,
        start=time_text(info.start_ns),
        duration_s=info.duration_s,
        messages=None if info.message_count < 0 else info.message_count,
        topics=[_topic(t, info.duration_s) for t in info.topics],
        compression=sorted(kinds),
        custom=info.custom,
        damaged=bool(losses or notes),
        lost_messages=lost,
        unverified_messages=unverified,
        damage=[{**loss.as_map(), "line": loss.line()} for loss in losses],
        notes=notes,
    )


def _topic(topic: TopicInfo, duration_s: float) -> TopicReport:
    known = topic.count >= 0
    rate = (topic.count - 1) / duration_s if topic.count > 1 and duration_s > 0.0 else None
    return TopicReport(
        name=topic.name,
        type=topic.type,
        count=topic.count if known else None,
        rate_hz=rate,
        qos=[p.as_map() for p in read_profiles(topic.qos)],
    )


def report_lines(report: BagReport) -> list[str]:
    """Return a report as lines for a person."""
    count = "unknown" if report["messages"] is None else str(report["messages"])
    lines = [
        f"bag:         {report['bag']}",
        f"files:       {', '.join(report['files'])} ({report['size']} bytes)",
        f"start:       {report['start']}",
        f"duration:    {report['duration_s']:.3f} s",
        f"messages:    {count}",
        f"compression: {', '.join(report['compression']) or 'unknown'}",
    ]
    lines += [f"{key}: {value}" for key, value in sorted(report["custom"].items())]
    lines.append("topics:")
    lines += [f"  {_topic_line(topic)}" for topic in report["topics"]]
    lines += [f"note: {note}" for note in report["notes"]]
    lines += [f"damage: {loss['line']}" for loss in report["damage"]]
    if report["damaged"]:
        lost = report["lost_messages"]
        lines.append(
            f"lost: {'unknown' if lost is None else lost} messages; "
            "rewrite the bag with 'valve-twin recover'"
        )
    return lines


def _topic_line(topic: TopicReport) -> str:
    count = "unknown" if topic["count"] is None else str(topic["count"])
    rate = "" if topic["rate_hz"] is None else f", {topic['rate_hz']:.2f} Hz"
    offers = sorted({f"{q['reliability']}, {q['durability']}" for q in topic["qos"]})
    qos = f", {'; '.join(offers)}" if offers else ""
    return f"{topic['name']}  {topic['type']}  {count}{rate}{qos}"
