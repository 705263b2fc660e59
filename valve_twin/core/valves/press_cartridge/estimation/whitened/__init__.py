# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled Kalman whitening: eight filters at once, the search of their noise ratio, moments."""
