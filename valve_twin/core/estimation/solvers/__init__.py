# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Small optimisation problems: bounded least squares, quadratic programs, identifiability."""
