# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The pure core: physics, estimation, cycles, twin and aging, without ROS, files or clocks."""
