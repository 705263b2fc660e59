# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Faults of a node and of its inputs: kinds with cause and remedy, life from raised to cleared."""
