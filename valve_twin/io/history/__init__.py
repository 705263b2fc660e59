# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The database of a valve: estimates, verdicts, maintenance; claim, rescue, export, fleet."""
