# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the recorder's parameters say, checked once at configure."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import TYPE_CHECKING, Any

from valve_twin.io.bags.qos import read_overrides
from valve_twin.io.bags.rolling import SplitRule
from valve_twin.io.config.recorder_parameters import BagRecorderParameters
from valve_twin.io.errors import ConfigError
from valve_twin.io.recording.recorder import DiskRule
from valve_twin.io.recording.restarted import next_folder
from valve_twin.io.recording.topic_choice import TopicChoice

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from valve_twin.nodes.runtime.node import ValveNode


@dataclass(frozen=True, slots=True)
class RecorderConfig:
    """What follows from the parameters, and the parameters themselves."""

    bag: Path
    choice: TopicChoice
    overrides: Mapping[str, Mapping[str, Any]]
    split: SplitRule
    disk: DiskRule
    custom: Mapping[str, str]
    given: BagRecorderParameters


def read_config(node: ValveNode) -> RecorderConfig:
    """Read the parameters of a recorder.

    Raises
    ------
    ConfigError
        Naming the parameter, its value and what to write.
    """
    p = node.parameters.read(BagRecorderParameters)
    now = datetime.now(timezone.utc).strftime("%Y%m%d_%H%M%S")
    path = p.qos_profile_overrides_path
    config = RecorderConfig(
        bag=next_folder(p.bag or f"valve_twin_{now}").absolute(),
        choice=_choice(node, p),
        overrides=read_overrides(path) if path else {},
        split=SplitRule(p.max_bag_size, p.max_bag_duration, p.keep_files),
        disk=DiskRule(p.min_free_bytes, p.when_disk_low == "delete_oldest", p.resume),
        custom=_custom(p.custom_data),
        given=p,
    )
    _check(config)
    return config


def _choice(node: ValveNode, p: BagRecorderParameters) -> TopicChoice:
    choice = TopicChoice(
        everything=p.all,
        topics=tuple(node.resolve_topic_name(t) for t in p.topics),
        types=p.types,
        regex=p.regex,
        exclude_topics=tuple(node.resolve_topic_name(t) for t in p.exclude_topics),
        exclude_types=p.exclude_types,
        exclude_regex=p.exclude_regex,
        hidden=p.include_hidden_topics,
        namespace=node.get_namespace(),
    )
    choice.check()
    return choice


def _check(config: RecorderConfig) -> None:
    if config.disk.delete_oldest and not (config.split.size or config.split.duration_s):
        msg = (
            "parameter 'when_disk_low': the running file is never deleted; "
            "set max_bag_size or max_bag_duration too"
        )
        raise ConfigError(msg)
    if not config.given.snapshot_mode:
        return
    try:
        re.compile(config.given.alarm_regex)
    except re.error as err:
        text = config.given.alarm_regex
        msg = f"parameter 'alarm_regex': '{text}' is no regular expression: {err}"
        raise ConfigError(msg) from err


def _custom(pairs: tuple[str, ...]) -> dict[str, str]:
    found = {}
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not equals or not key.strip():
            msg = f"parameter 'custom_data': '{pair}' has no key; write KEY=VALUE, as serial=4711"
            raise ConfigError(msg)
        found[key.strip()] = value.strip()
    return found
