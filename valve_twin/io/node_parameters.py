# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Parameters of the nodes beside those of the valve: one table a node.

Declared and documented from here.
"""

from __future__ import annotations

from valve_twin.io.schema import Kind, Spec

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
    Spec(
        "page",
        Kind.INT,
        200,
        "Estimates asked of the twin at a time.",
        "1",
        1,
        100000,
    ),
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
        "Messages at rate 0 between two answers of all subscribing nodes; at most their queue "
        "depth, 0 = do not ask.",
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

_BAG_RECORDER = (
    Spec(
        "bag",
        Kind.STRING,
        "",
        "Folder of the bag; empty = valve_twin_DATE in the working directory.",
    ),
    Spec("topics", Kind.STRINGS, (), "Topics to record; empty = all under the node's namespace."),
    Spec("all", Kind.BOOL, False, "Record all topics of every namespace."),
    Spec("flush_s", Kind.FLOAT, 1.0, "Longest time until data is in the file.", "s", 0.05, 60.0),
    Spec(
        "queue",
        Kind.INT,
        100000,
        "Messages that may wait for the disk; more are lost and counted.",
        "1",
        1,
        10**8,
    ),
)

NODE_PARAMETERS: dict[str, tuple[Spec, ...]] = {
    "simulated_valve": (*_COMMON, *_LIVE, *_SIMULATED_VALVE),
    "twin": (*_COMMON, *_TWIN),
    "aging_monitor": (*_COMMON, *_AGING_MONITOR),
    "bag_player": (*_COMMON, *_LIVE, *_BAG_PLAYER),
    "bag_recorder": (*_COMMON, *_BAG_RECORDER),
}
"""Parameters by node name."""
