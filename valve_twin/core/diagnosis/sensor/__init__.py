# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the position sensor shows by itself, whatever the valve makes."""
