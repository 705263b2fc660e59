# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Features, faults and signatures of any valve, from its position and the response of its model.

A valve that declares features and signatures of its own keeps those.
"""
