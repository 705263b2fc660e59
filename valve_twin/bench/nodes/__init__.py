# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Live nodes against bare rclpy nodes, all in processes of their own."""
