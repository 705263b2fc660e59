# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Estimation of a valve's parameters from one production cycle."""
