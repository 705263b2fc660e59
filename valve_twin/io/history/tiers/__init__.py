# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Old cycles of a history as hours and days: how they are condensed, and what is read of them."""
