# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a change of the features is: which fault fits, whether one ends, where it goes on."""
