# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a valve does in operation: its counters, its events, how it steps and strokes."""
