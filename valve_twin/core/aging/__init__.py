# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Follow each parameter over a valve's life: trend, remaining life, verdict, from the history."""

from valve_twin.core.aging.assess import Assessment, TrendDetail, assess
from valve_twin.core.aging.config import AgingConfig, Axis, Commissioning, Threshold
from valve_twin.core.aging.cutting.ahead import warm_up
from valve_twin.core.aging.verdict import Trend, TrendStatus, Verdict, VerdictKind

__all__ = [
    "AgingConfig",
    "Assessment",
    "Axis",
    "Commissioning",
    "Threshold",
    "Trend",
    "TrendDetail",
    "TrendStatus",
    "Verdict",
    "VerdictKind",
    "assess",
    "warm_up",
]
