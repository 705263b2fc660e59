# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read bags: what is in them, and signals as columns in log-time order.

A bag is a rosbag2 folder, its metadata.yaml or one .mcap file. Messages are decoded with the
definitions in the bag, and what was read is counted against the summary of each file.
"""

from __future__ import annotations

from valve_twin.io.bags.contents import BagInfo, TopicInfo, bag_info, bag_types, topic_name
from valve_twin.io.bags.folder import bag_files
from valve_twin.io.bags.qos import QosProfile
from valve_twin.io.bags.signals import SLICE_S, read_columns, read_signals
from valve_twin.io.bags.writer import BagWriter

__all__ = [
    "SLICE_S",
    "BagInfo",
    "BagWriter",
    "QosProfile",
    "TopicInfo",
    "bag_files",
    "bag_info",
    "bag_types",
    "read_columns",
    "read_signals",
    "topic_name",
]
