# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Parameters that every node has, and those of all that publish what a valve would."""

from __future__ import annotations

from dataclasses import dataclass

from valve_twin.core.quantity import quantity, setting


@dataclass(frozen=True, slots=True)
class NodeParameters:
    """Parameters of every node."""

    autostart: bool = setting(default=True, text="Configure and activate by itself at start.")
    executor: str = setting(
        "events",
        "Executor that drives the callbacks; events costs a quarter of single_threaded.",
        choices=("events", "single_threaded"),
    )
    allow_remote_configuration: bool = setting(
        default=False,
        text="Let parameter services set the clock, what names a place on this machine (files, "
        "databases) and how much is kept there.",
        local=True,
    )


@dataclass(frozen=True, slots=True)
class LiveParameters(NodeParameters):
    """Parameters of the nodes that publish what a valve would."""

    allow_live: bool = setting(
        default=False,
        text="Publish also to topics that already have a foreign publisher, and commands "
        "that somebody else takes.",
        local=True,
    )
    lossless: bool = setting(
        default=True,
        text="Wait for reliable subscribers rather than overwrite what they have not taken.",
    )
    wait_for_subscribers: int = quantity(
        0, "1", "Begin when this many nodes subscribe to every topic.", lower=0, upper=1000
    )
