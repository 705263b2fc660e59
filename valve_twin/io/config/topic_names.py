# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Names of topics; imports nothing, so that a node that needs no valve stays light."""

from __future__ import annotations


def resolve_topic(topic: str, valve: str, prefix: str = "") -> str:
    """Return the absolute topic of a signal, with the prefix of a simulation or player.

    Parameters
    ----------
    topic : str
        Topic, absolute with a leading slash.
    valve : str
        Name of the valve, put before a relative one.
    prefix : str
        Prefix of a simulation or player, may be empty.
    """
    absolute = topic if topic.startswith("/") else f"{valve.rstrip('/')}/{topic}"
    return f"/{prefix.strip('/')}{absolute}" if prefix.strip("/") else absolute
