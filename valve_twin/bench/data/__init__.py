# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Bags and the history: what is read, written and stored, against rosbags and bare SQLite."""
