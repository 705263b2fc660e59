# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Damaged MCAP files: what is intact is read, what is lost is named."""
