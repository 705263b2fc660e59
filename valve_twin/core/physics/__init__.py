# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Building blocks of the simulated valves: physical quantities with a range, and orifices."""
