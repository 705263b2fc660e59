# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Features held against a stored reference: that of this valve, or of valves like it."""
