# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Speed against what a user would write otherwise: same input, same output, one run, CPU time.

Every line is a ratio of medians; absolute figures stand beside the time of a reference loop (a
plain Python sum over a million numbers) of the same run. Results are asserted equal before a ratio
is printed.
"""

from valve_twin.bench.measure import Better, Ratio, Scale, describe, median, require_equal
from valve_twin.bench.run import AREAS, run_benchmarks, run_gate

__all__ = [
    "AREAS",
    "Better",
    "Ratio",
    "Scale",
    "describe",
    "median",
    "require_equal",
    "run_benchmarks",
    "run_gate",
]
