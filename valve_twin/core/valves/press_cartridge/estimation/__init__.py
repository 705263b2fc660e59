# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The estimators of the press valve: equation error, output error, Kalman-whitened."""
