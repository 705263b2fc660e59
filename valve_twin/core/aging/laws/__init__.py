# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Laws of aging: their shapes, how they are fitted and weighed, and a study of what they hold."""
