# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Parameters that every node has."""

from __future__ import annotations

from dataclasses import dataclass

from valve_twin.core.quantity import setting


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
        text="Let parameter services set what names a place on this machine: files, databases.",
        local=True,
    )
