# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the bag recorder writes: choice of topics, splits, ring buffer, without ROS."""
