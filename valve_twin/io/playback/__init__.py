# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the bag player plays: choice, order, QoS and types, without ROS."""
