# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How faults change the features of a cycle: `signatures.json`."""

from valve_twin.core.diagnosis.source import read_table

TABLE = read_table(__package__)
