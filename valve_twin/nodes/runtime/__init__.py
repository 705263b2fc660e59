# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What all nodes share: spin loop, signals, lifecycle, parameters, messages, faults."""
