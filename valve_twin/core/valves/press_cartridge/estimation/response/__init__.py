# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""When commands act, and what is wrong in every cycle alike."""
