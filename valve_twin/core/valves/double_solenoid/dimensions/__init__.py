# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which dimension of a designed solenoid has drifted: changes of its coenergy, fit, verdict."""
