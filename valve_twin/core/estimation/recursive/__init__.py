# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Recursive estimation: parameters followed from sample to sample."""
