# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Cycles that are judged as they come, each once, and what is remembered of them."""
