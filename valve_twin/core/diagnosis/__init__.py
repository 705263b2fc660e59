# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Tell a fault from aging: what a cycle shows, how faults change it, which fault it is."""
