# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The node simulated_valve."""
