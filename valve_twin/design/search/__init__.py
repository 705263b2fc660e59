# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Many designs: which dimension matters, and which design is better."""
