# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the aging of a valve is judged by, kept in files: a long history is not read anew."""

WORTH = 4000
"""Estimates from which on what was read is kept [1], assumed: reading as many takes 0.2 s."""
