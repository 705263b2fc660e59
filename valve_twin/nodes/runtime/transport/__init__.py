# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How the middleware carries what nodes say, and what a killed process leaves in its way."""
