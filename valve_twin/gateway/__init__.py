# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Faces of a history without ROS: pages for a browser, JSON, Prometheus; all read only."""
