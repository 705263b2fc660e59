# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Load what the estimation of a press valve needs, in the process that `conftest` lets fork."""

from valve_twin.core.types import CycleRule
from valve_twin.warmup import run_once

run_once("press_cartridge", CycleRule.COUNTER)
