# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Faults of a control valve from its official signals, learnt from one healthy record."""
