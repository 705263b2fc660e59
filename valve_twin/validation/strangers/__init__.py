# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Presses that are not the twin's own simulator, and how the twin stands before them."""
