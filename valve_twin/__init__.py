# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Digital twins of valves: physical parameters, prediction, residual and aging trend."""

__all__ = ["__version__"]

__version__ = "0.1.0"
