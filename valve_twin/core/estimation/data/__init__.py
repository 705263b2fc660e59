# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Samples before any fit: which may be used, which repeat, how much they scatter at rest."""
