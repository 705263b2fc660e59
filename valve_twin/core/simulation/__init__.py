# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The simulated valve: any valve's plant with production cycles, aging, faults and a measurement layer."""
