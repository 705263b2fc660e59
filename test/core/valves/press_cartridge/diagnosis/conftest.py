# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The simulated press valve of the tests of diagnosis."""

from test.core.diagnosis.conftest import rig, started, table

__all__ = ["rig", "started", "table"]
