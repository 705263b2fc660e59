# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A Functional Mock-up Unit of others as the plant of a simulated valve."""
