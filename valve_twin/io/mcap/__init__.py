# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The MCAP container: records, a reader over a memory map, a writer that survives a kill."""
