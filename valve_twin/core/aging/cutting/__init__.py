# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Cut one undisturbed stretch of a history into pieces; long ones by a schedule."""
