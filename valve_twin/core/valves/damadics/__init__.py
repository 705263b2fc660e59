# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A control valve with positioner after the DAMADICS benchmark, with its 19 faults."""

from valve_twin.core.valves.damadics.model import MODEL

__all__ = ["MODEL"]
