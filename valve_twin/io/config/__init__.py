# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Configuration: YAML of a valve, parameters of the nodes, names; a mistake is one line."""
