# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Strangers of the generic verdict: valves of another hand, with equations of their own."""
