# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Parameters of the nodes beside those of the valve: a dataclass a node.

Nodes declare them and the reference lists them from here.
"""

from __future__ import annotations

from dataclasses import dataclass

from valve_twin.core.quantity import Descriptor, assumed, describe, quantity, setting
from valve_twin.io.config.every_node import LiveParameters, NodeParameters
from valve_twin.io.config.gateway_parameters import GatewayParameters
from valve_twin.io.config.recorder_parameters import BagRecorderParameters


@dataclass(frozen=True, slots=True)
class SimulatedValveParameters(LiveParameters):
    """Parameters of the simulated valve."""

    publish_prefix: str = setting(
        "/sim",
        "Put before every topic that is published or taken, so that no real valve is moved.",
        local=True,
    )
    rate: float = quantity(
        1.0,
        "1",
        "Simulated seconds a second; 0 = as fast as the subscribers follow.",
        lower=0.0,
        upper=1e4,
    )
    clock: bool = setting(
        default=False, text="Publish /clock; where it is not given, a rate other than 1 does."
    )
    seed: int = quantity(0, "1", "Seed of all random numbers.", lower=0, upper=2**31)
    start_time_s: float = quantity(
        0.0, "s", "Stamp of the first sample; 0 = the time at activation.", lower=0.0, upper=2e9
    )
    batch: int = quantity(1, "1", "Samples a message; above 1 as Float64Series.", 1, 10000)
    joint: str = setting("", "Joint to be, too: JointState in joint_states, joint_commands.")
    joint_stroke: float = quantity(1.0, "m", "Position of the joint at 1.", 1e-6, 1e3)
    stop_after_cycles: int = quantity(
        0, "1", "Stop after so many production cycles; 0 = never.", lower=0, upper=10**9
    )


@dataclass(frozen=True, slots=True)
class TwinParameters(NodeParameters):
    """Parameters of the twin."""

    backup_folder: str = setting(
        "",
        "Folder below which backup_history writes; empty = backups beside the database.",
        local=True,
    )
    backups_kept: int = quantity(
        20,
        "1",
        "So many files there may be; then backup_history refuses.",
        lower=0,
        upper=10**6,
        local=True,
    )
    input_queue: int = quantity(
        100000,
        "1",
        "Queue depth of every input; 0 = what is not taken yet holds up a lossless publisher.",
        lower=0,
        upper=10**6,
    )
    deadline_s: float = quantity(
        0.0,
        "s",
        "Longest time between two messages that publishers have to promise; 0 = none asked for.",
        lower=0.0,
        upper=3600.0,
    )
    silence_s: float = assumed(
        5.0, "s", "After this long without a message an input is reported.", 0.1, 1e6
    )
    prediction_batch_s: float = quantity(
        0.0,
        "s",
        "Data time of one PredictionSeries into which predictions are collected, less"
        " where a cycle ends or samples are missing; 0 = a message for each of the "
        "inputs.",
        lower=0.0,
        upper=60.0,
    )
    estimate_wait_s: float = assumed(
        0.5,
        "s",
        "Longest wait of a prediction for the estimate that its cycle is due, of live"
        " inputs; then the model in force goes on and says reproducible: false. 0 = "
        "for ever, as with use_sim_time and topics below /replay.",
        0.0,
        3600.0,
    )
    memory_budget_mb: float = assumed(
        400.0,
        "MB",
        "Memory of all cycles that wait for their estimation; more wait on disk beside the "
        "history, and where that is full the oldest are dropped and counted.",
        0.01,
        1e6,
        local=True,
    )
    retry_s: float = assumed(
        1.0, "s", "Pause before a cycle that the database refused is offered again.", 0.01, 3600.0
    )
    unsaved_limit: int = assumed(
        10000,
        "1",
        "Cycles kept in memory while the database refuses them; beyond it the oldest "
        "are lost and counted.",
        1,
        10**7,
        local=True,
    )
    state_folder: str = setting(
        "",
        "Folder in which cycles wait, over restarts too, while the server of the history is away,"
        " and those beyond memory_budget_mb; a SQLite history has them beside it. Empty = "
        "$STATE_DIRECTORY, which systemd sets; without it they wait in memory.",
        local=True,
    )
    busy_timeout_s: float = assumed(
        5.0, "s", "How long another program's lock of the database is waited for.", 0.0, 3600.0
    )
    events_kept: int = quantity(
        10000,
        "1",
        "Events kept of a valve, beside the first of each failure not acknowledged.",
        10,
        10**6,
        local=True,
    )
    keep_cycles: int = quantity(
        0,
        "1",
        "Newest cycles of a valve, 1000 at least, that are kept one by one; once a day older ones"
        " are condensed to hours and days. Both 0 = all are kept.", 0, 10**9, local=True,
    )  # fmt: skip
    keep_days: float = quantity(
        0.0,
        "d",
        "Age up to which cycles are kept, likewise; either rule keeps.",
        0,
        1e5,
        local=True,
    )
    keep_hours_for_days: float = quantity(
        90.0, "d", "Age up to which hours are kept beside days.", 0, 1e5, local=True
    )


@dataclass(frozen=True, slots=True)
class AgingMonitorParameters(NodeParameters):
    """Parameters of the aging monitor."""

    page: int = quantity(200, "1", "Estimates asked of the twin at a time.", lower=1, upper=100000)
    retry_s: float = assumed(
        1.0, "s", "Pause before a twin that does not answer is asked again.", 0.01, 3600.0
    )
    state_folder: str = setting(
        "",
        "Folder in which what is known of each valve is kept for the next start, which then "
        "asks the twin only for what is new; empty = nothing is kept.",
        local=True,
    )


@dataclass(frozen=True, slots=True)
class BagPlayerParameters(LiveParameters):
    """Parameters of the bag player."""

    bag: str = setting("", "Folder of the bag.", local=True)
    publish_prefix: str = setting(
        "/replay", "Put before every topic, so that no real valve is moved.", local=True
    )
    replaced_prefixes: tuple[str, ...] = setting(
        ("/sim", "/replay"),
        "Recorded prefixes that publish_prefix replaces, where it begins with /sim or /replay "
        "itself; empty = put it before them.",
        local=True,
    )
    topics: tuple[str, ...] = setting((), "Topics to play; empty with an empty regex = all.")
    regex: str = setting("", "Play also topics in whose name this expression is found.")
    exclude_topics: tuple[str, ...] = setting((), "Topics not to play.")
    exclude_regex: str = setting("", "Do not play topics in whose name this expression is found.")
    remap: tuple[str, ...] = setting((), "New names before the prefix is put, each /old:=/new.")
    qos_overrides_path: str = setting(
        "", "YAML file of policies by recorded topic, as ros2 bag play takes it.", local=True
    )
    rate: float = quantity(
        1.0,
        "1",
        "Bag seconds a second; 0 = as fast as the subscribers follow.",
        lower=0.0,
        upper=1e4,
    )
    window: int = quantity(
        5000,
        "1",
        "Where lossless: messages between two answers of all subscribing nodes; at "
        "most their queue depth, 0 = do not ask.",
        lower=0,
        upper=10**6,
    )
    clock: bool = setting(default=True, text="Publish /clock, in place of a recorded one.")
    clock_hz: float = quantity(
        0.0,
        "1/s",
        "How often /clock is published; 0 = before every message.",
        lower=0.0,
        upper=1000.0,
    )
    clock_topics: tuple[str, ...] = setting(
        (),
        "Recorded topics before whose messages /clock is published where clock_hz is "
        "0; empty = all.",
    )
    start_paused: bool = setting(default=False, text="Wait for the service resume.")
    loop: bool = setting(default=False, text="Begin again at the end.")
    delay_s: float = quantity(0.0, "s", "Pause before playing, before every loop too.", lower=0.0)
    start_delay_s: float = quantity(
        3.0,
        "s",
        "Longest wait for every topic to be subscribed before the first message.",
        lower=0.0,
        upper=3600.0,
    )
    exit_at_end: bool = setting(default=False, text="End the process when the bag is played.")
    acked_wait_s: float = quantity(
        5.0,
        "s",
        "Longest wait at the end until every message is acknowledged.",
        lower=0.0,
        upper=3600.0,
    )
    start_offset_s: float = quantity(
        0.0, "s", "Begin this long after the first message.", lower=0.0
    )
    duration_s: float = quantity(0.0, "s", "Bag time to play; 0 = to the end.", lower=0.0)
    until_ns: int = quantity(
        0,
        "ns",
        "Log time to stop at, the earlier of this and duration_s counts; 0 = the end.",
        lower=0,
        upper=2**62,
    )


@dataclass(frozen=True, slots=True)
class OpcuaSourceParameters(NodeParameters):
    """Parameters of the source of a PLC's tags."""

    address: str = setting("opc.tcp://127.0.0.1:4840", "OPC UA server of the PLC.", local=True)
    tags: tuple[str, ...] = setting(
        (), "Lines TOPIC NODE_ID: what is subscribed and where it is published.", local=True
    )
    publish_prefix: str = setting(
        "/plc",
        "Put before every topic, so that nothing that moves a valve hears it; the twin's "
        "topic_prefix.",
        local=True,
    )
    allow_live: bool = setting(
        default=False,
        text="Publish also to topics that somebody else publishes or takes.",
        local=True,
    )
    period_s: float = quantity(
        0.0,
        "s",
        "Sampling time of the tags: samples that keep it go together as Float64Series and missing "
        "ones are counted; 0 = a Float64Stamped each.",
        lower=0.0,
        upper=3600.0,
    )
    publishing_ms: float = quantity(
        50.0, "ms", "The server collects samples for so long.", lower=1.0, upper=60000.0
    )
    sampling_ms: float = quantity(
        0.0,
        "ms",
        "The server looks at a tag so often; 0 = as fast as it can.",
        lower=0.0,
        upper=60000.0,
    )
    queue: int = quantity(
        10000,
        "1",
        "Samples of a tag that the server is asked to keep: 10 s of 1 kHz.",
        lower=1,
        upper=10**6,
    )
    user: str = setting("", "User; the password stands in VALVE_TWIN_OPCUA_PASSWORD.", local=True)
    pki: str = setting(
        "",
        "Folder with our certificate.der and key.pem for Basic256Sha256; empty = not encrypted.",
        local=True,
    )


NODES = {
    "simulated_valve": SimulatedValveParameters,
    "twin": TwinParameters,
    "aging_monitor": AgingMonitorParameters,
    "bag_player": BagPlayerParameters,
    "bag_recorder": BagRecorderParameters,
    "opcua_source": OpcuaSourceParameters,
    "gateway": GatewayParameters,
}
"""Parameters by node name."""

NODE_PARAMETERS: dict[str, tuple[Descriptor, ...]] = {
    name: describe(parameters) for name, parameters in NODES.items()
}
"""Their descriptors."""
