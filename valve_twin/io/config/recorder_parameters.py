# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Parameters of the recorder."""

from __future__ import annotations

from dataclasses import dataclass

from valve_twin.core.quantity import quantity, setting
from valve_twin.io.config.every_node import NodeParameters


@dataclass(frozen=True, slots=True)
class RecordedTopics(NodeParameters):
    """Which topics the recorder takes."""

    bag: str = setting(
        "", "Folder of the bag; empty = valve_twin_DATE in the working directory.", local=True
    )
    topics: tuple[str, ...] = setting(
        (), "Topics to record; with regex and types empty too, all under the node's namespace."
    )
    all: bool = setting(default=False, text="Record all topics of every namespace.")
    regex: str = setting("", "Record topics in whose name this expression is found.")
    types: tuple[str, ...] = setting((), "Record topics of these message types.")
    exclude_topics: tuple[str, ...] = setting((), "Topics to leave out.")
    exclude_regex: str = setting("", "Leave out topics in whose name this is found.")
    exclude_types: tuple[str, ...] = setting((), "Message types to leave out.")
    include_hidden_topics: bool = setting(
        default=False, text="Record also topics with a part that begins with an underscore."
    )
    discovery_s: float = quantity(
        0.0,
        "s",
        "How long new topics are looked for after activation; 0 = always.",
        lower=0.0,
        upper=1e6,
    )
    qos_profile_overrides_path: str = setting(
        "",
        "YAML file of QoS policies by topic, as `ros2 bag record` takes it; what it "
        "does not name adapts to the publishers.",
        local=True,
    )
    start_paused: bool = setting(default=False, text="Wait for the service resume.")


@dataclass(frozen=True, slots=True)
class RecordedFiles(RecordedTopics):
    """How the recorder writes its files."""

    flush_s: float = quantity(
        0.5, "s", "Longest time until a message is written and synced.", lower=0.05, upper=60.0
    )
    queue: int = quantity(
        100000,
        "1",
        "Messages that may wait for the disk; more are lost and counted.",
        lower=1,
        upper=10**8,
    )
    queue_bytes: int = quantity(
        100 * 2**20,
        "B",
        "Bytes that may wait for the disk; more are lost and counted.",
        lower=1000,
        upper=2**40,
        local=True,
    )
    max_bag_size: int = quantity(
        0,
        "B",
        "Size after which a new file begins; 0 = never.",
        lower=0,
        upper=2**50,
        local=True,
    )
    max_bag_duration: float = quantity(
        0.0,
        "s",
        "Time after which a new file begins; 0 = never.",
        lower=0.0,
        upper=1e9,
        local=True,
    )
    keep_files: int = quantity(
        0,
        "1",
        "Files kept, older ones are deleted; 0 = all.",
        lower=0,
        upper=10**6,
        local=True,
    )
    min_free_bytes: int = quantity(
        100_000_000,
        "B",
        "Free space on the disk that is left to others.",
        lower=0,
        upper=2**50,
        local=True,
    )
    when_disk_low: str = setting(
        "stop",
        "Below that space stop writing, or delete the oldest files of this bag first.",
        choices=("stop", "delete_oldest"),
        local=True,
    )
    resume: bool = setting(default=True, text="Go on in a new file when the disk has space again.")
    custom_data: tuple[str, ...] = setting(
        (), "Values for the bag's metadata, each as KEY=VALUE: valve, serial number, software."
    )


@dataclass(frozen=True, slots=True)
class BagRecorderParameters(RecordedFiles):
    """Parameters of the bag recorder, with those of snapshots."""

    snapshot_mode: bool = setting(
        default=False,
        text="Keep the last messages in memory and write them only on ~/snapshot or an alarm.",
    )
    snapshot_s: float = quantity(
        60.0,
        "s",
        "Time that the snapshot buffer spans; 0 = bounded by its bytes alone.",
        lower=0.0,
        upper=1e6,
    )
    snapshot_bytes: int = quantity(
        100 * 2**20,
        "B",
        "Memory of the snapshot buffer.",
        lower=1000,
        upper=2**40,
        local=True,
    )
    snapshot_cycles: int = quantity(
        0,
        "1",
        "Whole production cycles in a snapshot, the last ones; 0 = all that is buffered.",
        lower=0,
        upper=10**6,
    )
    snapshot_after_s: float = quantity(
        0.0,
        "s",
        "How long is waited after an alarm before the snapshot is taken.",
        lower=0.0,
        upper=3600.0,
    )
    alarms: tuple[str, ...] = setting(
        ("diagnostics", "verdict"),
        "What takes a snapshot by itself: an ERROR on /diagnostics, a verdict that "
        "the valve, command, sensor or supply changed.",
        choices=("diagnostics", "verdict"),
    )
    alarm_regex: str = setting(
        "", "Names on /diagnostics that alarm; empty = those of nodes and valves in the namespace."
    )
    alarm_pause_s: float = quantity(
        60.0,
        "s",
        "After an alarm's snapshot further alarms take none for this long.",
        lower=0.0,
        upper=1e6,
    )
    cycle_topic: str = setting("twin/cycle", "Where the cycles are announced.")
    verdict_topic: str = setting("aging_monitor/verdict", "Where the verdict is given.")
