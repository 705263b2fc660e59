# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Parameters of the nodes beside those of the valve: one table a node.

Declared and documented from here.
"""

from __future__ import annotations

from valve_twin.core.quantity import Kind
from valve_twin.io.config.schema import Spec

_COMMON = (
    Spec("autostart", Kind.BOOL, True, "Configure and activate by itself at start."),
    Spec(
        "executor",
        Kind.STRING,
        "events",
        "Executor that drives the callbacks; events costs a quarter of single_threaded.",
        choices=("events", "single_threaded"),
    ),
)

_LIVE = (
    Spec(
        "allow_live",
        Kind.BOOL,
        False,
        "Publish also to topics that already have a foreign publisher, and commands that "
        "somebody else takes.",
    ),
    Spec(
        "lossless",
        Kind.BOOL,
        True,
        "Wait for reliable subscribers rather than overwrite what they have not taken.",
    ),
    Spec(
        "wait_for_subscribers",
        Kind.INT,
        0,
        "Begin when every topic has this many subscribers.",
        "1",
        0,
        1000,
    ),
)

_SIMULATED_VALVE = (
    Spec(
        "publish_prefix",
        Kind.STRING,
        "/sim",
        "Put before every topic that is published or taken, so that no real valve is moved.",
    ),
    Spec(
        "rate",
        Kind.FLOAT,
        1.0,
        "Simulated seconds a second; 0 = as fast as the subscribers follow.",
        "1",
        0.0,
        1e4,
    ),
    Spec("clock", Kind.BOOL, False, "Publish /clock; a rate other than 1 always does."),
    Spec("seed", Kind.INT, 0, "Seed of all random numbers.", "1", 0, 2**31),
    Spec(
        "start_time_s",
        Kind.FLOAT,
        0.0,
        "Stamp of the first sample; 0 = the time at activation.",
        "s",
        0.0,
        2e9,
    ),
    Spec("batch", Kind.INT, 1, "Samples a message; above 1 as Float64Series.", "1", 1, 10000),
    Spec(
        "stop_after_cycles",
        Kind.INT,
        0,
        "Stop after so many production cycles; 0 = never.",
        "1",
        0,
        10**9,
    ),
)

_TWIN = (
    Spec(
        "input_queue",
        Kind.INT,
        100000,
        "Queue depth of every input; 0 = what is not taken yet holds up a lossless publisher.",
        "1",
        0,
        10**6,
    ),
    Spec(
        "deadline_s",
        Kind.FLOAT,
        0.0,
        "Longest time between two messages that publishers have to promise; 0 = none asked for.",
        "s",
        0.0,
        3600.0,
    ),
    Spec(
        "silence_s",
        Kind.FLOAT,
        5.0,
        "After this long without a message an input is reported.",
        "s",
        0.1,
        1e6,
    ),
    Spec(
        "prediction_batch_s",
        Kind.FLOAT,
        0.0,
        "Data time of one PredictionSeries into which predictions are collected, less where a "
        "cycle ends or samples are missing; 0 = a message for each of the inputs.",
        "s",
        0.0,
        60.0,
    ),
    Spec(
        "estimate_wait_s",
        Kind.FLOAT,
        0.5,
        "Longest wait of a prediction for the estimate that its cycle is due, of live inputs; "
        "then the model in force goes on and says reproducible: false. 0 = for ever, as with "
        "use_sim_time and topics below /replay.",
        "s",
        0.0,
        3600.0,
    ),
    Spec(
        "retry_s",
        Kind.FLOAT,
        1.0,
        "Pause before a cycle that the database refused is offered again.",
        "s",
        0.01,
        3600.0,
    ),
    Spec(
        "unsaved_limit",
        Kind.INT,
        10000,
        "Cycles kept in memory while the database refuses them; beyond it the oldest are lost "
        "and counted.",
        "1",
        1,
        10**7,
    ),
    Spec(
        "busy_timeout_s",
        Kind.FLOAT,
        5.0,
        "How long another program's lock of the database is waited for.",
        "s",
        0.0,
        3600.0,
    ),
)

_AGING_MONITOR = (
    Spec("page", Kind.INT, 200, "Estimates asked of the twin at a time.", "1", 1, 100000),
    Spec(
        "retry_s",
        Kind.FLOAT,
        1.0,
        "Pause before a twin that does not answer is asked again.",
        "s",
        0.01,
        3600.0,
    ),
)

_BAG_PLAYER = (
    Spec("bag", Kind.STRING, "", "Folder of the bag."),
    Spec(
        "publish_prefix",
        Kind.STRING,
        "/replay",
        "Put before every topic, so that no real valve is moved.",
    ),
    Spec("topics", Kind.STRINGS, (), "Topics to play; empty with an empty regex = all."),
    Spec("regex", Kind.STRING, "", "Play also topics in whose name this expression is found."),
    Spec("exclude_topics", Kind.STRINGS, (), "Topics not to play."),
    Spec(
        "exclude_regex",
        Kind.STRING,
        "",
        "Do not play topics in whose name this expression is found.",
    ),
    Spec("remap", Kind.STRINGS, (), "New names before the prefix is put, each /old:=/new."),
    Spec(
        "qos_overrides_path",
        Kind.STRING,
        "",
        "YAML file of policies by recorded topic, as ros2 bag play takes it.",
    ),
    Spec(
        "rate",
        Kind.FLOAT,
        1.0,
        "Bag seconds a second; 0 = as fast as the subscribers follow.",
        "1",
        0.0,
        1e4,
    ),
    Spec(
        "window",
        Kind.INT,
        5000,
        "Where lossless: messages between two answers of all subscribing nodes; at most their "
        "queue depth, 0 = do not ask.",
        "1",
        0,
        10**6,
    ),
    Spec("clock", Kind.BOOL, True, "Publish /clock, in place of a recorded one."),
    Spec(
        "clock_hz",
        Kind.FLOAT,
        0.0,
        "How often /clock is published; 0 = before every message.",
        "1/s",
        0.0,
        1000.0,
    ),
    Spec(
        "clock_topics",
        Kind.STRINGS,
        (),
        "Recorded topics before whose messages /clock is published where clock_hz is 0; "
        "empty = all.",
    ),
    Spec("start_paused", Kind.BOOL, False, "Wait for the service resume."),
    Spec("loop", Kind.BOOL, False, "Begin again at the end."),
    Spec("delay_s", Kind.FLOAT, 0.0, "Pause before playing, before every loop too.", "s", 0.0),
    Spec(
        "start_delay_s",
        Kind.FLOAT,
        3.0,
        "Longest wait for every topic to be subscribed before the first message.",
        "s",
        0.0,
        3600.0,
    ),
    Spec("exit_at_end", Kind.BOOL, False, "End the process when the bag is played."),
    Spec(
        "acked_wait_s",
        Kind.FLOAT,
        5.0,
        "Longest wait at the end until every message is acknowledged.",
        "s",
        0.0,
        3600.0,
    ),
    Spec("start_offset_s", Kind.FLOAT, 0.0, "Begin this long after the first message.", "s", 0.0),
    Spec("duration_s", Kind.FLOAT, 0.0, "Bag time to play; 0 = to the end.", "s", 0.0),
    Spec(
        "until_ns",
        Kind.INT,
        0,
        "Log time to stop at, the earlier of this and duration_s counts; 0 = the end.",
        "ns",
        0,
        2**62,
    ),
)

_RECORDED_TOPICS = (
    Spec(
        "topics",
        Kind.STRINGS,
        (),
        "Topics to record; with regex and types empty too, all under the node's namespace.",
    ),
    Spec("all", Kind.BOOL, False, "Record all topics of every namespace."),
    Spec("regex", Kind.STRING, "", "Record topics in whose name this expression is found."),
    Spec("types", Kind.STRINGS, (), "Record topics of these message types."),
    Spec("exclude_topics", Kind.STRINGS, (), "Topics to leave out."),
    Spec("exclude_regex", Kind.STRING, "", "Leave out topics in whose name this is found."),
    Spec("exclude_types", Kind.STRINGS, (), "Message types to leave out."),
    Spec(
        "include_hidden_topics",
        Kind.BOOL,
        False,
        "Record also topics with a part that begins with an underscore.",
    ),
    Spec(
        "discovery_s",
        Kind.FLOAT,
        0.0,
        "How long new topics are looked for after activation; 0 = always.",
        "s",
        0.0,
        1e6,
    ),
    Spec(
        "qos_profile_overrides_path",
        Kind.STRING,
        "",
        "YAML file of QoS policies by topic, as `ros2 bag record` takes it; "
        "what it does not name adapts to the publishers.",
    ),
)

_RECORDED_FILES = (
    Spec(
        "flush_s",
        Kind.FLOAT,
        0.5,
        "Longest time until a message is written and synced.",
        "s",
        0.05,
        60.0,
    ),
    Spec(
        "queue",
        Kind.INT,
        100000,
        "Messages that may wait for the disk; more are lost and counted.",
        "1",
        1,
        10**8,
    ),
    Spec(
        "queue_bytes",
        Kind.INT,
        100 * 2**20,
        "Bytes that may wait for the disk; more are lost and counted.",
        "B",
        1000,
        2**40,
    ),
    Spec(
        "max_bag_size",
        Kind.INT,
        0,
        "Size after which a new file begins; 0 = never.",
        "B",
        0,
        2**50,
    ),
    Spec(
        "max_bag_duration",
        Kind.FLOAT,
        0.0,
        "Time after which a new file begins; 0 = never.",
        "s",
        0.0,
        1e9,
    ),
    Spec("keep_files", Kind.INT, 0, "Files kept, older ones are deleted; 0 = all.", "1", 0, 10**6),
    Spec(
        "min_free_bytes",
        Kind.INT,
        100_000_000,
        "Free space on the disk that is left to others.",
        "B",
        0,
        2**50,
    ),
    Spec(
        "when_disk_low",
        Kind.STRING,
        "stop",
        "Below that space stop writing, or delete the oldest files of this bag first.",
        choices=("stop", "delete_oldest"),
    ),
    Spec("resume", Kind.BOOL, True, "Go on in a new file when the disk has space again."),
    Spec(
        "custom_data",
        Kind.STRINGS,
        (),
        "Values for the bag's metadata, each as KEY=VALUE: valve, serial number, software.",
    ),
)

_SNAPSHOTS = (
    Spec(
        "snapshot_mode",
        Kind.BOOL,
        False,
        "Keep the last messages in memory and write them only on ~/snapshot or an alarm.",
    ),
    Spec(
        "snapshot_s",
        Kind.FLOAT,
        60.0,
        "Time that the snapshot buffer spans; 0 = bounded by its bytes alone.",
        "s",
        0.0,
        1e6,
    ),
    Spec(
        "snapshot_bytes",
        Kind.INT,
        100 * 2**20,
        "Memory of the snapshot buffer.",
        "B",
        1000,
        2**40,
    ),
    Spec(
        "snapshot_cycles",
        Kind.INT,
        0,
        "Whole production cycles in a snapshot, the last ones; 0 = all that is buffered.",
        "1",
        0,
        10**6,
    ),
    Spec(
        "snapshot_after_s",
        Kind.FLOAT,
        0.0,
        "How long is waited after an alarm before the snapshot is taken.",
        "s",
        0.0,
        3600.0,
    ),
    Spec(
        "alarms",
        Kind.STRINGS,
        ("diagnostics", "verdict"),
        "What takes a snapshot by itself: an ERROR on /diagnostics, "
        "a verdict that the valve, command, sensor or supply changed.",
        choices=("diagnostics", "verdict"),
    ),
    Spec(
        "alarm_regex",
        Kind.STRING,
        "",
        "Names on /diagnostics that alarm; empty = those of nodes and valves in the namespace.",
    ),
    Spec(
        "alarm_pause_s",
        Kind.FLOAT,
        60.0,
        "After an alarm's snapshot further alarms take none for this long.",
        "s",
        0.0,
        1e6,
    ),
    Spec("cycle_topic", Kind.STRING, "twin/cycle", "Where the cycles are announced."),
    Spec("verdict_topic", Kind.STRING, "aging_monitor/verdict", "Where the verdict is given."),
)

_BAG_RECORDER = (
    Spec(
        "bag",
        Kind.STRING,
        "",
        "Folder of the bag; empty = valve_twin_DATE in the working directory.",
    ),
    *_RECORDED_TOPICS,
    Spec("start_paused", Kind.BOOL, False, "Wait for the service resume."),
    *_RECORDED_FILES,
    *_SNAPSHOTS,
)

NODE_PARAMETERS: dict[str, tuple[Spec, ...]] = {
    "simulated_valve": (*_COMMON, *_LIVE, *_SIMULATED_VALVE),
    "twin": (*_COMMON, *_TWIN),
    "aging_monitor": (*_COMMON, *_AGING_MONITOR),
    "bag_player": (*_COMMON, *_LIVE, *_BAG_PLAYER),
    "bag_recorder": (*_COMMON, *_BAG_RECORDER),
}
"""Parameters by node name."""
