# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The valves: one package each, known to the house through `interface` and `registry`."""
