# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Soft landing: a controller of the seating speed, and how it is scored."""
