# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The DAMADICS benchmark: 44 scenarios, a healthy day, its performance indices."""
