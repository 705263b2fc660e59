# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the history keeps of a valve's operation: its counters and its event log."""
