# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Text tables of any program."""
