# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What shows without a signature: the sensor over all products, and what no sound valve does."""
