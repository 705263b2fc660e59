# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Follow each parameter over a valve's life: trend, remaining life, verdict, from the history."""
