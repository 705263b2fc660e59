# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A recorded or simulated bag through the same twin as live: estimates, predictions, proposals."""
