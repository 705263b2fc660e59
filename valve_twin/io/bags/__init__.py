# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Bags of rosbag2 in MCAP: contents, types, definitions, signals; writing them."""
