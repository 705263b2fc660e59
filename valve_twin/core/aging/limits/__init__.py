# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Where a trend stands to its warning limit and its service limit, and when a life is told."""
