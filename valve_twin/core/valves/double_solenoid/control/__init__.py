# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Position controllers of the double-solenoid valve, and what one of them observes."""
