# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The moving plot of a valve: samples into a drawing that grows, told to all who look."""
