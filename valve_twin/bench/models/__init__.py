# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Plants, estimators and recursions against what scipy, cvxpy and padasip take for the same."""
