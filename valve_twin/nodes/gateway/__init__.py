# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The gateway node: a history and its live twins in a browser."""
