# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A valve as a Functional Mock-up Unit: C from its law, values from its history."""
