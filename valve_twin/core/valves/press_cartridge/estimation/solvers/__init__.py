# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The small quadratic programme of the constrained estimate, and searches along a line."""
