# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Any command to any answer: static curves before and behind linear dynamics; ARX without them."""

from valve_twin.core.valves.hammerstein_wiener.model import MODEL

__all__ = ["MODEL"]
