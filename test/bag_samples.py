# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Samples of a test's bag, one by one."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.io.cdr.codec import encode_stamped
from valve_twin.io.cdr.signals import STAMPED_TYPE

if TYPE_CHECKING:
    from valve_twin.io.bags.writer import BagWriter


def write_sample(
    bag: BagWriter, topic: str, stamp_ns: int, value: float, *, log_ns: int | None = None
) -> None:
    """Append a Float64Stamped to a topic, added where it is not known."""
    bag.add_topic(topic, STAMPED_TYPE)
    at = stamp_ns if log_ns is None else log_ns
    bag.write(topic, encode_stamped(stamp_ns, value), log_ns=at, publish_ns=stamp_ns)
