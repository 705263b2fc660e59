# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The way of a live twin's cycles into the history, and what becomes of them when they are old."""
